"""Frames in which persons move and are tracked without doubt: they show delays and turns of views."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.limbs import smallness
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Array, frozen
from tracker.tracking.estimate import Estimate

MOST_MOMENTS = 24
"""Number of frames of each person to compare, the fastest ones: with as many, delays are known to a hundredth of a
frame."""

_STRETCHES = 3
"""Stretches of a recording; the fastest third of as many frames of each is always compared: a change on the way shows
in frames before and after."""

_LEAST_M_PER_S = 0.2
"""Mean speed of the joints below which a frame shows no delays: views of a person who moved at 3 mm a frame seemed a
frame late."""

_MOST_TURNED = 1.2
"""An angle that changes by more in two frames jumped, or its joint is near gimbal lock, rad."""


@dataclass(frozen=True)
class Tracked:
    """The poses of all persons in one frame."""

    index: int
    time_s: float
    estimates: tuple[Estimate, ...]


@dataclass(frozen=True)
class Moment:
    """A frame, one of its persons, and that person's movement."""

    frame: Frame
    scene: Scene
    """All persons at their poses."""

    person: int
    rates: Array
    """(2, dof) velocities of its parameters, rad/s and m/s, and accelerations, per s more."""

    def later(self, q: Array, late_s: float) -> Array:
        """The pose that the movement reaches from a pose (dof,) after a time."""
        pose: Array = q + late_s * self.rates[0] + 0.5 * late_s**2 * self.rates[1]
        return pose


def rates_of(body: BodyModel, frames: Sequence[Tracked], person: int) -> Array:
    """(T, 2, dof) velocities of the parameters, rad/s and m/s, and accelerations, by two frames on both sides.

    By one frame on both sides if there are no more: at 12.5 frames a second it sees 0.84 of the speed of two steps a
    second. NaN where the person is lost; 0 where it is unknown: at the ends of the track, and where an angle jumps.
    """
    lost = np.array([one.estimates[person].lost for one in frames])
    times = np.array([one.time_s for one in frames])
    poses = np.array([one.estimates[person].q for one in frames])
    poses[lost] = np.nan
    rates = np.zeros((len(frames), 2, body.dof))
    if len(frames) > 2:
        interval_s = (times[2:] - times[:-2])[:, None] / 2
        near, bend = _steps(body, poses, 1)
        known = np.isfinite(near) & ~(body.rotates & (np.abs(near) > _MOST_TURNED))
        rates[1:-1, 0] = np.where(known, near, 0.0) / (2 * interval_s)
        rates[1:-1, 1] = np.where(known, bend, 0.0) / interval_s**2
        if len(frames) > 4:
            far, _ = _steps(body, poses, 2)
            wide = known[1:-1] & np.isfinite(far) & ~(body.rotates & (np.abs(far) > 2 * _MOST_TURNED))
            finer = (8 * near[1:-1] - far) / (12 * interval_s[1:-1])
            rates[2:-2, 0] = np.where(wide, finer, rates[2:-2, 0])
    rates[lost] = np.nan
    return frozen(rates)


def rates_at(body: BodyModel, frames: Sequence[Tracked], person: int, place: int) -> Array:
    """(2, dof) the rates of one of some frames in turn, see `rates_of`; 0 if unknown.

    The first and the last frame have those of their neighbour, carried on by its acceleration.
    """
    rates = np.nan_to_num(rates_of(body, frames, person))
    beside = min(max(place, 1), max(len(frames) - 2, 0))
    velocities, accelerations = rates[beside]
    since_s = frames[place].time_s - frames[beside].time_s
    return frozen([velocities + since_s * accelerations, accelerations])


def _steps(body: BodyModel, poses: Array, width: int) -> tuple[Array, Array]:
    """Differences from the frame so many before, and to the frame as many after; angles unwound.

    Args:
        body: owner of the poses.
        poses: (T, dof), NaN where unknown.
        width: frames on both sides.

    Returns:
        Two of (T - 2 width, dof).
    """
    middle = poses[width:-width]
    before, after = poses[: -2 * width] - middle, poses[2 * width :] - middle
    before, after = (np.where(body.rotates, np.arctan2(np.sin(d), np.cos(d)), d) for d in (before, after))
    return after - before, after + before


def chosen_moments(scene: Scene, frames: Sequence[Tracked]) -> Mapping[int, tuple[tuple[int, Array], ...]]:
    """The frames in which persons move fastest and without doubt, in that frame and its neighbours.

    Args:
        scene: the persons and the rig.
        frames: the poses found.

    Returns:
        Number of a frame -> persons and the rates (2, dof) of their parameters.
    """
    found: dict[int, list[tuple[int, Array]]] = {}
    for k, person in enumerate(scene.persons):
        rates = rates_of(person.body, frames, k)
        doubtful = np.array([bool(one.estimates[k].doubts) for one in frames])
        sure = ~doubtful & ~np.r_[True, doubtful[:-1]] & ~np.r_[doubtful[1:], True]
        if not sure.any():
            continue
        poses = np.array([one.estimates[k].q for one in frames])
        speeds = np.where(sure, speed(person.body, poses, np.nan_to_num(rates[:, 0])), 0.0)
        for t in _fastest(speeds):
            if speeds[t] >= _LEAST_M_PER_S:
                found.setdefault(frames[t].index, []).append((k, rates[t]))
    return {index: tuple(persons) for index, persons in sorted(found.items())}


def _fastest(speeds: Array) -> list[int]:
    """The fastest frames of all, and of each stretch, by the speeds (T,) in all of them."""
    places, n_each = np.arange(len(speeds)), MOST_MOMENTS // _STRETCHES
    stretches = [places, *np.array_split(places, _STRETCHES)]
    fastest = [
        stretch[np.argsort(-speeds[stretch])][:most]
        for stretch, most in zip(stretches, (MOST_MOMENTS, *[n_each] * _STRETCHES), strict=True)
    ]
    return sorted({int(t) for one in fastest for t in one})


def speed(body: BodyModel, poses: Array, rates: Array) -> Array:
    """(...,) mean speed of the joints at poses (..., dof) whose parameters change at such rates (..., dof), m/s.

    A body smaller than a person counts as if it were as large: a hand's joints move as many pixels at a tenth of the
    speed.
    """
    instant_s = 1e-3
    steps = body.landmarks_in_world(poses + instant_s * rates) - body.landmarks_in_world(poses)
    speeds: Array = np.linalg.norm(steps, axis=-1).mean(axis=-1) / (instant_s * smallness(body))
    return speeds


def moments_of(
    scene: Scene,
    frames: Sequence[Tracked],
    chosen: Mapping[int, Sequence[tuple[int, Array]]],
    images: Iterable[Frame],
) -> list[Moment]:
    """The chosen frames with their images, read up to the last of them.

    Args:
        scene: the persons and the rig.
        frames: the poses found.
        chosen: see `chosen_moments`.
        images: the recording from its start on.
    """
    poses = {one.index: tuple(estimate.q for estimate in one.estimates) for one in frames if one.index in chosen}
    found: list[Moment] = []
    left = set(poses)
    for frame in images if left else ():
        if frame.index in left:
            posed = scene.with_poses(poses[frame.index])
            found.extend(Moment(frame, posed, k, rate) for k, rate in chosen[frame.index])
            left.remove(frame.index)
            if not left:
                break
    return found
