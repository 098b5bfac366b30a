"""Least squares: delays and turns of views that bring contours and edges of tracked persons together.

An adjustment as in photogrammetry, with the pose of each person in each frame among the unknowns, so that what a
displaced pose would explain is not taken for a delay: they are eliminated frame by frame (Schur complement).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.alignment import ViewAlignment
from tracker.alignment._looks import POSE_SPREAD, Look, looks_of
from tracker.alignment.moments import Moment, speed
from tracker.arrays import Array, frozen
from tracker.progress import Progress, silent
from tracker.rig import Rig

FEWEST = 8
"""Moments below which nothing is said."""

_GATES_PX = (12.0, 8.0, 6.0, 5.0, 5.0)
"""Largest distance of a pair in each round, px."""

_TURN_SPREAD_PX = 0.5
"""Standard deviation of turns, px at the middle of an image, so that what moving the world would explain is not
ascribed to the cameras; far more pairs speak for a turn that is one."""

_DELAY_SPREAD_FRAMES = 2.0
"""Standard deviation of delays: holds that of a view that shows nothing."""


def align(moments: Sequence[Moment], interval_s: float, progress: Progress = silent) -> ViewAlignment | None:
    """Delays and turns of the views; None where too few moments, or one view alone, tell nothing.

    Args:
        moments: of one rig.
        interval_s: from one frame to the next, seconds.
        progress: told how far it is.
    """
    if len(moments) < FEWEST or len(moments[0].scene.rig) < 2:
        return None
    rig = moments[0].scene.rig
    looks = [looks_of(moment) for moment in moments]
    poses = [moment.scene.persons[moment.person].q for moment in moments]
    prior, unknowns = _prior(rig), np.zeros(4 * len(rig) - 1)
    sums = _Sums.nothing(len(unknowns))
    for done, gate_px in enumerate(_GATES_PX):
        progress("comparing the views", done, len(_GATES_PX))
        by_now = turned(rig, unknowns[len(rig) - 1 :].reshape(-1, 3))
        delays_s = interval_s * np.r_[0.0, unknowns[: len(rig) - 1]]
        parts = [
            _eliminated(moment, [look.by(by_now) for look in seen], q, delays_s, interval_s, gate_px)
            for moment, seen, q in zip(moments, looks, poses, strict=True)
        ]
        sums = _Sums(np.array([part.matrix for part in parts]), np.array([part.vector for part in parts]))
        step = sums.step(prior, unknowns)
        poses = [part.moved(q, step) for part, q in zip(parts, poses, strict=True)]
        unknowns = unknowns + step
    progress("comparing the views", len(_GATES_PX), len(_GATES_PX))
    posed = list(zip(moments, poses, strict=True))
    sigmas, n_delays = sums.sigmas(prior, unknowns), len(rig) - 1
    return ViewAlignment(
        rig,
        interval_s,
        frozen(interval_s * np.r_[0.0, unknowns[:n_delays]]),
        frozen(interval_s * np.r_[0.0, sigmas[:n_delays]]),
        frozen(unknowns[n_delays:].reshape(-1, 3)),
        frozen(sigmas[n_delays:].reshape(-1, 3)),
        len(moments),
        frozen(np.mean([_place(moment) for moment in moments], axis=0)),
        float(np.mean([speed(moment.scene.persons[moment.person].body, q, moment.rates[0]) for moment, q in posed])),
    )


def turned(rig: Rig, turns: Array) -> Rig:
    """The rig with each camera turned in its place by a rotation vector (V, 3) in its coordinates, rad."""
    cameras = []
    for camera, turn in zip(rig.cameras, turns, strict=True):
        motion = np.eye(4)
        motion[:3, :3] = Rotation.from_rotvec(np.array(turn)).as_matrix()
        cameras.append(replace(camera, camera_from_world=motion @ camera.camera_from_world))
    return Rig(tuple(cameras))


@dataclass(frozen=True)
class _Sums:
    """The equations of the unknowns of all moments, whose poses are eliminated."""

    matrices: Array
    """(M, G, G)"""

    vectors: Array
    """(M, G)"""

    @staticmethod
    def nothing(n_unknowns: int) -> _Sums:
        """Of no moment."""
        return _Sums(np.zeros((0, n_unknowns, n_unknowns)), np.zeros((0, n_unknowns)))

    def step(self, prior: Array, at: Array) -> Array:
        """(G,) from unknowns to better ones."""
        step: Array = -np.linalg.solve(self.matrices.sum(axis=0) + prior, self.vectors.sum(axis=0) + prior @ at)
        return step

    def sigmas(self, prior: Array, at: Array) -> Array:
        """(G,) standard deviations of the unknowns, by leaving out each moment in turn (jackknife)."""
        n, every = len(self.vectors), np.arange(len(self.vectors))
        without = [replace(self, matrices=self.matrices[every != k], vectors=self.vectors[every != k]) for k in every]
        steps = np.array([sums.step(prior, at) for sums in without])
        sigmas: Array = np.sqrt((n - 1) / n * ((steps - steps.mean(axis=0)) ** 2).sum(axis=0))
        return sigmas


@dataclass(frozen=True)
class _Eliminated:
    """What a moment says of delays and turns, whatever its pose."""

    matrix: Array
    """(G, G)"""

    vector: Array
    """(G,)"""

    still: Array
    """(dof,) step of the pose if delays and turns stay."""

    per_unknown: Array
    """(dof, G) its change with these."""

    def moved(self, q: Array, step: Array) -> Array:
        """The pose (dof,) that goes with a step of the unknowns (G,)."""
        pose: Array = q + self.still + self.per_unknown @ step
        return pose


def _eliminated(
    moment: Moment, looks: Sequence[Look], q: Array, delays_s: Array, interval_s: float, gate_px: float
) -> _Eliminated:
    """The equations of a moment; unknowns are delays of all views but the first, in frames, and turns of all views."""
    person, n_views = moment.scene.persons[moment.person], len(delays_s)
    spread = np.where(person.body.rotates, *POSE_SPREAD)
    matrix, vector = np.diag(spread**-2), (q - person.q) / spread**2
    n_unknowns = 4 * n_views - 1
    crossed, own, right = np.zeros((n_unknowns, len(q))), np.zeros((n_unknowns, n_unknowns)), np.zeros(n_unknowns)
    for look in looks:
        residuals, jacobian, by_turn, weights = look.rows(moment.later(q, delays_s[look.view]), gate_px)
        columns = np.zeros((len(residuals), n_unknowns))
        if look.view:
            columns[:, look.view - 1] = jacobian @ (interval_s * moment.rates[0])
        first = n_views - 1 + 3 * look.view
        columns[:, first : first + 3] = by_turn
        weighted, weighted_columns = weights[:, None] * jacobian, weights[:, None] * columns
        matrix = matrix + jacobian.T @ weighted
        vector = vector + weighted.T @ residuals
        crossed += columns.T @ weighted
        own += columns.T @ weighted_columns
        right += weighted_columns.T @ residuals
    solved = np.linalg.solve(matrix, np.column_stack([vector, crossed.T]))
    return _Eliminated(own - crossed @ solved[:, 1:], right - crossed @ solved[:, 0], -solved[:, 0], -solved[:, 1:])


def _prior(rig: Rig) -> Array:
    """(G, G) how firmly delays and turns are held at nothing."""
    turns = [camera.matrix[0, 0] / _TURN_SPREAD_PX for camera in rig.cameras]
    return np.diag(np.r_[np.full(len(rig) - 1, 1 / _DELAY_SPREAD_FRAMES), np.repeat(turns, 3)] ** 2)


def _place(moment: Moment) -> Array:
    """(3,) middle of the person's joints, metres."""
    person = moment.scene.persons[moment.person]
    place: Array = person.body.landmarks_in_world(person.q[None])[0].mean(axis=0)
    return place
