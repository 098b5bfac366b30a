"""Poses brought to one moment, that of the first view, where views are late."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Array, frozen
from tracker.results.alignment import ViewAlignment
from tracker.results.alignment._looks import POSE_SPREAD, looks_of
from tracker.results.alignment.moments import Moment, Tracked, rates_of
from tracker.tracking.estimate import Estimate

_GATES_PX = (10.0, 8.0, 6.0, 6.0)
"""Largest distance of a contour and its edge in each step, px."""


def in_step(
    scene: Scene, frames: Sequence[Tracked], found: ViewAlignment, images: Iterable[Frame]
) -> Iterator[tuple[int, tuple[Estimate, ...]]]:
    """The estimates of all persons at the first view's moment.

    Each view is compared with the pose that the movement has reached when that view looks: the pose in question, and
    on from there for as long as the view is late, as the poses tracked move. Lost persons stay as they are.

    Args:
        scene: the persons, and the rig that they were tracked with.
        frames: the poses found.
        found: how late the views are.
        images: the recording from its start on.

    Yields:
        Number of a frame and its estimates.
    """
    rates = [rates_of(person.body, frames, k) for k, person in enumerate(scene.persons)]
    places = {one.index: t for t, one in enumerate(frames)}
    for frame in images:
        t = places.get(frame.index)
        if t is None:
            continue
        estimates = list(frames[t].estimates)
        posed = scene.with_poses(tuple(estimate.q for estimate in estimates))
        for k, estimate in enumerate(estimates):
            if not estimate.lost:
                q = _at_one_moment(Moment(frame, posed, k, rates[k][t]), found.delays_at(frame.index))
                estimates[k] = replace(estimate, q=q)
        yield frame.index, tuple(estimates)


def _at_one_moment(moment: Moment, delays_s: Array) -> Array:
    """(dof,) the pose of a person when the first view looks."""
    person, looks = moment.scene.persons[moment.person], looks_of(moment)
    spread = np.where(person.body.rotates, *POSE_SPREAD)
    q = person.q
    for gate_px in _GATES_PX:
        matrix, vector = np.diag(spread**-2), (q - person.q) / spread**2
        for look in looks:
            residuals, jacobian, _, weights = look.rows(moment.later(q, delays_s[look.view]), gate_px)
            weighted = weights[:, None] * jacobian
            matrix, vector = matrix + jacobian.T @ weighted, vector + weighted.T @ residuals
        q = person.body.clamped(q - np.linalg.solve(matrix, vector))
    return frozen(q)
