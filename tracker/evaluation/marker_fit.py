"""One robust fit of motion, time and joint offsets between a track and markers of the same movement."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.arrays import Array, Integers, Mask
from tracker.evaluation.marker_set import MarkerJoints
from tracker.evaluation.time_correlation import Clocked

_LEAST_SAMPLES = 6
"""Joints in frames; seven unknowns have twice as many coordinates and more."""

NOISE_M = 0.003
"""Distances below the noise of markers on cloth do not rank one sample above another."""

_SCALE = 2.0
"""Of the robust function, in medians: a third of the samples may be wrong, one arm of an upper body."""

_FAR_M = 0.15
"""Beyond it a sample says only that it does not fit; half of an upper arm."""

_BESIDE_M = 0.015
"""Standard deviation of a joint's centre about the middle of its markers, in each direction: half a wrist."""

_INDEPENDENT = 10
"""Moments of a recording that say something of their own about how far a joint lies beside its markers."""

_N_DRAWS = 300
"""Of three samples each: 1 - 1e-17 that one of them is right though half of the samples are wrong."""

_N_JUDGES = 600
"""Samples by which the draws are ranked."""

_N_STEPS = 60
"""Of the robust fit; it takes ten to twenty, more only where an arm is wrong."""

_STILL = 1e-8
"""Radians, metres and seconds below which a step of the fit has ended."""

REACH_S = 0.5
"""A fit changes the time by at most so much: on a track with a lost arm, angles have told it to 0.3 s."""

_STRIDE_S = 0.05
"""Most that one step changes it: how markers move is known near by only."""


@dataclass(frozen=True)
class Placement:
    """How the marker system's clock and world lie to ours: ``t_marker = t + offset``, ``x_marker = R x + t``."""

    offset_s: float
    """What the marker clock shows more than ours, seconds."""

    rotation: Array
    """(3, 3) marker world from ours."""

    translation_m: Array
    """(3,) marker world from ours."""

    beside_m: Array
    """(J, 3) our joint centre minus the middle of its markers, in the frames that turn with them."""

    median_mm: float = float("nan")
    """Distance of the joints of both, in the middle."""

    deciding: float = float("nan")
    """Share of the samples that decided: those within two medians."""

    n_samples: int = 0
    """Joints in frames that both have."""

    def in_our_world(self, points: Array) -> Array:
        """Points (..., 3) of the marker world in ours, metres."""
        moved: Array = (points - self.translation_m) @ self.rotation
        return moved

    def in_their_world(self, points: Array) -> Array:
        """Points (..., 3) of our world in that of the markers, metres."""
        moved: Array = points @ self.rotation.T + self.translation_m
        return moved


@dataclass(frozen=True)
class _Samples:
    """Joints in frames that both have."""

    mine: Array
    """(N, 3) in our world."""

    other: Array
    """(N, 3) middles of markers at that time, in their world."""

    speed: Array
    """(N, 3) of the markers, m/s."""

    axes: Array
    """(N, 3, 3) that turn with the markers."""

    joint: Integers
    """(N,) which joint it is."""


def placed(ours: Clocked, theirs: MarkerJoints, near_s: float, reach_s: float = REACH_S) -> Placement | None:
    """Motion and offset of least robust distance near an offset; None where too little is seen by both."""
    found = _samples(ours, theirs, near_s)
    if len(found.mine) < _LEAST_SAMPLES:
        return None
    rotation, translation = _by_triples(found.mine, found.other)
    start = Placement(near_s, rotation, translation, np.zeros((ours.points.shape[1], 3)))
    return refined(ours, theirs, start, reach_s)


def refined(ours: Clocked, theirs: MarkerJoints, start: Placement, reach_s: float = REACH_S) -> Placement | None:
    """Gauss-Newton with Geman-McClure weights over twist, time, and where each joint lies beside its markers.

    Args:
        ours: (T, J) joints of a track.
        theirs: the same joints of markers.
        start: where to begin.
        reach_s: most that the offset changes, seconds.

    Returns:
        The placement; None where too little is seen by both.
    """
    near_s, now = start.offset_s, start
    for _ in range(_N_STEPS):
        found = _samples(ours, theirs, now.offset_s)
        if len(found.mine) < _LEAST_SAMPLES:
            return None
        step = _step(found, now, theirs.shifts, len(ours.times_s))
        stride = np.clip(step[6], -_STRIDE_S, _STRIDE_S)
        now = replace(
            now,
            offset_s=float(np.clip(now.offset_s + stride, near_s - reach_s, near_s + reach_s)),
            rotation=Rotation.from_rotvec(step[:3]).as_matrix() @ now.rotation,
            translation_m=now.translation_m + step[3:6],
            beside_m=now.beside_m + step[7:].reshape(-1, 3),
        )
        if np.abs(step).max() < _STILL:
            break
    found = _samples(ours, theirs, now.offset_s)
    if len(found.mine) < _LEAST_SAMPLES:
        return None
    distance = np.linalg.norm(_residual(found, now), axis=1)
    deciding = float((distance < _scale(distance)).mean())
    median_mm = 1000 * float(np.median(distance))
    return replace(now, median_mm=median_mm, deciding=deciding, n_samples=len(distance))


def _samples(ours: Clocked, theirs: MarkerJoints, offset_s: float) -> _Samples:
    when = ours.times_s + offset_s
    other, speed, axes = theirs.at(when), theirs.velocities_at(when), theirs.frames_at(when)
    known = [np.isfinite(values).all(axis=-1) for values in (ours.points, other, speed)]
    seen: Mask = np.logical_and.reduce([*known, np.isfinite(axes).all(axis=(-1, -2))])
    return _Samples(ours.points[seen], other[seen], speed[seen], axes[seen], np.nonzero(seen)[1])


def _residual(found: _Samples, now: Placement) -> Array:
    beside = np.einsum("nij,nj->ni", found.axes, now.beside_m[found.joint])
    residual: Array = now.in_their_world(found.mine) - found.other - beside
    return residual


def _scale(distance: Array) -> float:
    return _SCALE * max(float(np.median(distance)), NOISE_M)


def _step(found: _Samples, now: Placement, shifts: tuple[bool, ...], n_frames: int) -> Array:
    """(7 + 3 J,) rotation vector, translation, offset and shifts that lessen the weighted distances most."""
    residual = _residual(found, now)
    distance = np.linalg.norm(residual, axis=1)
    scale = _scale(distance)
    # Samples of one joint err alike for a while: all of a recording weigh as `_INDEPENDENT` moments do.
    alike = np.sqrt(min(1.0, _INDEPENDENT / n_frames)) * _SCALE / scale
    weight = alike * scale**2 / (scale**2 + distance**2)
    jacobian = np.zeros((len(residual), 3, 7 + 3 * len(shifts)))
    turned = found.mine @ now.rotation.T
    jacobian[:, :, :3] = np.cross(np.eye(3), turned[:, None]).transpose(0, 2, 1)
    jacobian[:, :, 3:6] = np.eye(3)
    jacobian[:, :, 6] = -found.speed
    for joint, moves in enumerate(shifts):
        own = found.joint == joint
        if moves:
            jacobian[own, :, 7 + 3 * joint : 10 + 3 * joint] = -found.axes[own]
    prior = np.hstack([np.zeros((3 * len(shifts), 7)), np.eye(3 * len(shifts)) / _BESIDE_M])
    rows = np.vstack([(weight[:, None, None] * jacobian).reshape(-1, jacobian.shape[2]), prior])
    wanted = np.concatenate([(weight[:, None] * residual).ravel(), now.beside_m.ravel() / _BESIDE_M])
    step: Array = np.linalg.lstsq(rows, -wanted, rcond=None)[0]
    return step


def _by_triples(mine: Array, other: Array) -> tuple[Array, Array]:
    """Rotation and translation that most samples agree with, of random triples (the same in every call)."""
    rng = np.random.default_rng(0)
    judges = rng.choice(len(mine), min(_N_JUDGES, len(mine)), replace=False)
    best: tuple[float, Array, Array] = np.inf, np.eye(3), np.zeros(3)
    for _ in range(_N_DRAWS):
        chosen = rng.choice(len(mine), 3, replace=False)
        rotation, translation = rigid_motion(mine[chosen], other[chosen])
        distance = np.linalg.norm(mine[judges] @ rotation.T + translation - other[judges], axis=1)
        cost = float((np.minimum(distance, _FAR_M) ** 2).mean())
        if cost < best[0]:
            best = cost, rotation, translation
    return best[1:]


def rigid_motion(points: Array, target: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,) that bring points (N, 3) nearest to a target (N, 3) (Kabsch, 1976)."""
    middle, there = points.mean(axis=0), target.mean(axis=0)
    u, _, vt = np.linalg.svd((points - middle).T @ (target - there))
    upright = np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))])
    rotation: Array = vt.T @ upright @ u.T
    return rotation, there - rotation @ middle
