"""One robust fit of motion, time and joint offsets between a track and markers of the same movement."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.errors import SequenceError
from tracker.foundation.geometry import rigid_motion
from tracker.results.evaluation.marker_set import MarkerJoints
from tracker.results.evaluation.time_correlation import Clocked, offsets_by_angles

FAR_M = 0.15
"""Beyond it a sample says only that it does not fit; half of an upper arm."""

_N_DRAWS = 300
"""Of three samples each: 1 - 1e-17 that one of them is right though half of the samples are wrong."""

_N_JUDGES = 600
"""Samples by which the draws are ranked."""


def by_triples(mine: Array, other: Array) -> tuple[Array, Array]:
    """Rotation and translation that most samples agree with, of random triples (the same in every call)."""
    rng = np.random.default_rng(0)
    judges = rng.choice(len(mine), min(_N_JUDGES, len(mine)), replace=False)
    best: tuple[float, Array, Array] = np.inf, np.eye(3), np.zeros(3)
    for _ in range(_N_DRAWS):
        chosen = rng.choice(len(mine), 3, replace=False)
        motion = rigid_motion(mine[chosen], other[chosen])
        rotation, translation = motion[:3, :3], motion[:3, 3]
        distance = np.linalg.norm(mine[judges] @ rotation.T + translation - other[judges], axis=1)
        cost = float((np.minimum(distance, FAR_M) ** 2).mean())
        if cost < best[0]:
            best = cost, rotation, translation
    return best[1:]


_LEAST_SAMPLES = 6
"""Joints in frames; seven unknowns have twice as many coordinates and more."""

NOISE_M = 0.003
"""Distances below the noise of markers on cloth do not rank one sample above another."""

_NEAR = 2.0
"""Medians of the distance within which a sample counts as one that decided."""

_TAILS = 3.0
"""Degrees of freedom of Student's distribution of a joint's samples: an arm may be lost for a while only."""

_MEDIAN_OF_THREE = 2.366
"""Of the sum of the squares of three normal deviates (chi square)."""

_LOST_M = 0.06
"""Standard deviation, in each direction, above which a joint says nothing, if three others are three times as steady.
An arm turned about its shoulder by 30 to 170 degrees still drew the rotation by 0.03 degrees along."""

_BESIDE_TAILS = 2.0
"""The same of how far joints lie beside their markers: where a body's pelvis is, no marker set says (80 mm)."""

_BESIDE_M = 0.015
"""Standard deviation of a joint's centre about the middle of its markers, in each direction: half a wrist."""

_INDEPENDENT = 10
"""Moments of a recording that say something of their own about how far a joint lies beside its markers."""

_N_STEPS = 100
"""Of the robust fit; it takes fifteen to sixty, more only where an arm is wrong for a while."""

_STILL = 1e-6
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
    """(J, C) our joint centre minus the middle of its markers, in the axes that turn with them and with the bone."""

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
    """(N, 3, C) that turn with the markers and with the bone."""

    joint: Integers
    """(N,) which joint it is."""


def placed(ours: Clocked, theirs: MarkerJoints, near_s: float, reach_s: float = REACH_S) -> Placement | None:
    """Motion and offset of least robust distance near an offset; None where too little is seen by both."""
    found = _samples(ours, theirs, near_s)
    if len(found.mine) < _LEAST_SAMPLES:
        return None
    rotation, translation = by_triples(found.mine, found.other)
    start = Placement(near_s, rotation, translation, np.zeros(theirs.frames.shape[1::2]))
    return refined(ours, theirs, start, reach_s)


def refined(ours: Clocked, theirs: MarkerJoints, start: Placement, reach_s: float = REACH_S) -> Placement | None:
    """Maximum likelihood of twist, time, and where each joint lies beside its markers, with a spread for each joint.

    A joint's samples follow Student's distribution about their place, with a spread that is found as well (EM: Lange,
    Little and Taylor, JASA 1989). A limb in a wrong place says little, then, however near it is, and a joint that is
    far beside its markers, but always alike, much. With one scale for all samples an arm that was carried off drew
    the alignment up to 12 deg and 78 mm along; 1.5 deg and 14 mm since: docs/lab/marker_alignment.md.

    Args:
        ours: (T, J) joints of a track.
        theirs: the same joints of markers.
        start: where to begin.
        reach_s: most that the offset changes, seconds.

    Returns:
        The placement; None where too little is seen by both.
    """
    near_s, now = start.offset_s, start
    variances: Array | None = None
    for _ in range(_N_STEPS):
        found = _samples(ours, theirs, now.offset_s)
        if len(found.mine) < _LEAST_SAMPLES:
            return None
        residual = _residual(found, now)
        variances = _variances(found, residual, variances, now.beside_m)
        weight = _weights(found, residual, variances, len(ours.times_s))
        step = _step(found, now, theirs.shifts, residual, weight)
        stride = np.clip(step[6], -_STRIDE_S, _STRIDE_S)
        now = replace(
            now,
            offset_s=float(np.clip(now.offset_s + stride, near_s - reach_s, near_s + reach_s)),
            rotation=Rotation.from_rotvec(step[:3]).as_matrix() @ now.rotation,
            translation_m=now.translation_m + step[3:6],
            beside_m=now.beside_m + step[7:].reshape(now.beside_m.shape),
        )
        if np.abs(step).max() < _STILL:
            break
    found = _samples(ours, theirs, now.offset_s)
    if len(found.mine) < _LEAST_SAMPLES:
        return None
    distance = np.linalg.norm(_residual(found, now), axis=1)
    median_mm = 1000 * float(np.median(distance))
    deciding = float((distance < _NEAR * max(median_mm / 1000, NOISE_M)).mean())
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


def _variances(found: _Samples, residual: Array, before: Array | None, beside_m: Array) -> Array:
    """(J,) square metres, in each direction, of the joints' samples, not below the markers' noise.

    At first about the place beside the markers where each joint mostly is: one that is far beside them counts, too.
    """
    variances = np.full(len(beside_m), FAR_M**2)
    square = (residual**2).sum(axis=1)
    if before is None:
        own = np.einsum("nij,ni->nj", found.axes[..., :3], residual)
        for joint in np.unique(found.joint):
            mine = own[found.joint == joint]
            variances[joint] = np.median(((mine - np.median(mine, axis=0)) ** 2).sum(axis=1)) / _MEDIAN_OF_THREE
    else:
        share = _share(square, before[found.joint])
        for joint in np.unique(found.joint):
            mine = found.joint == joint
            variances[joint] = (share[mine] * square[mine]).mean() / 3
    least: Array = np.maximum(variances, NOISE_M**2 / 3)
    return least


def _share(square: Array, variance: Array) -> Array:
    """What a sample counts beside one in the middle of its joint's distribution."""
    share: Array = (_TAILS + 3) / (_TAILS + square / variance)
    return share


def _weights(found: _Samples, residual: Array, variances: Array, n_frames: int) -> Array:
    """(N,) roots of what the samples weigh, 1/m."""
    variance = variances[found.joint]
    # Samples of one joint err alike for a while: all of a recording weigh as `_INDEPENDENT` moments do.
    alike = min(1.0, _INDEPENDENT / n_frames)
    weight: Array = np.sqrt(alike * _share((residual**2).sum(axis=1), variance) / variance)
    steady = np.sort(variances[np.unique(found.joint)])[:3].max()
    weight[variance > max(_LOST_M**2, 9 * steady)] = 0.0
    return weight


def _step(found: _Samples, now: Placement, shifts: tuple[bool, ...], residual: Array, weight: Array) -> Array:
    """(7 + J C,) rotation vector, translation, offset and shifts that lessen the weighted distances most."""
    n_joints, n_axes = now.beside_m.shape
    jacobian = np.zeros((len(residual), 3, 7 + n_joints * n_axes))
    turned = found.mine @ now.rotation.T
    jacobian[:, :, :3] = np.cross(np.eye(3), turned[:, None]).transpose(0, 2, 1)
    jacobian[:, :, 3:6] = np.eye(3)
    jacobian[:, :, 6] = -found.speed
    for joint, moves in enumerate(shifts):
        own = found.joint == joint
        if moves:
            jacobian[own, :, 7 + n_axes * joint : 7 + n_axes * (joint + 1)] = -found.axes[own]
    # Student's distribution again: few joints lie far beside their markers, and they are not drawn back.
    far = (now.beside_m.reshape(-1, 3) ** 2).sum(axis=1) / _BESIDE_M**2
    prior = np.repeat((_BESIDE_TAILS + 3) / (_BESIDE_TAILS + far), 3) / _BESIDE_M**2
    rows = (weight[:, None, None] * jacobian).reshape(-1, jacobian.shape[2])
    # Normal equations: quicker than singular values of the rows; distances, angles and seconds are of one size.
    normal: Array = rows.T @ rows
    wanted = rows.T @ (weight[:, None] * residual).ravel()
    normal[range(7, len(normal)), range(7, len(normal))] += prior
    wanted[7:] += prior * now.beside_m.ravel()
    step = np.linalg.lstsq(normal, -wanted, rcond=None)[0]
    return np.asarray(step, dtype=np.float64)


_LEAST_JOINTS = 3
"""Fewer do not tell how the worlds are turned."""

_NEARLY = 1.5
"""Of the distance in the middle: what another push-up may have."""


@dataclass(frozen=True)
class Alignment:
    """A placement, and how well it is known."""

    placement: Placement

    correlation: float
    """Of the flexion angles at the offset that they proposed; NaN where the offset was given."""

    rival_offset_s: float
    """Another offset that fits nearly as well, as with periodic movement; NaN if none does."""

    offset_sigma_s: float
    """Standard error by leaving out one joint after another: what is wrong with one joint is in it."""

    rotation_sigma_deg: float
    """The same of the rotation."""

    position_sigma_mm: float
    """The same of where the middle of all joints comes to lie."""


def align(
    ours: Clocked, theirs: MarkerJoints, hinges: list[tuple[int, int, int]], offset_s: float | None = None
) -> Alignment:
    """Finds how a marker recording lies to a track of the same movement.

    The time is proposed by correlating the flexion of hinges, which no frame of reference changes. From each proposal
    a rigid motion is found by random triples of samples, then motion and time together with weights that let a lost
    arm count for nothing. The proposal that fits best is taken.

    Args:
        ours: joints of the track.
        theirs: the same joints, from markers.
        hinges: columns of the joint before, the hinge, and the joint behind.
        offset_s: the offset where it is known within a tenth of a second; None to find it.

    Raises:
        SequenceError: nothing in common, or movement that tells no offset.
    """
    n_joints = ours.points.shape[1]
    if n_joints < _LEAST_JOINTS:
        raise SequenceError(f"{n_joints} joints in the marker set, expected {_LEAST_JOINTS} or more")
    proposals = offsets_by_angles(ours, theirs, hinges) if offset_s is None else [(float("nan"), offset_s)]
    reach_s = REACH_S if offset_s is None else _GIVEN_S
    tried = [(placed(ours, theirs, proposed, reach_s), correlation) for correlation, proposed in proposals]
    ended = [(fit, told, proposed) for (fit, told), (_, proposed) in zip(tried, proposals, strict=True) if fit]
    if not ended:
        raise SequenceError("no three joints are seen by both at the same time: check the marker set and --offset")
    most = max(fit.n_samples for fit, _, _ in ended)
    stayed = [one for one in ended if abs(one[0].offset_s - one[2]) < _INSIDE * reach_s]
    fits = sorted(stayed, key=lambda one: _worth_mm(one[0], most))
    if not fits:
        raise SequenceError(
            f"joints and markers do not move alike at {ended[0][2]:.2f} s: the fit leaves it by over {reach_s:g} s; "
            "check that the files show the same movement, the marker set, and --offset"
        )
    (best, correlation, _), *others = fits
    nearly_mm = _NEARLY * (_worth_mm(best, most) + 1000 * NOISE_M)
    rivals = [fit.offset_s for fit, _, _ in others if _worth_mm(fit, most) < nearly_mm]
    rival = next((other for other in rivals if abs(other - best.offset_s) > _SAME_S), float("nan"))
    return Alignment(best, correlation, rival, *_errors(best, ours, theirs))


def _worth_mm(fit: Placement, most: int) -> float:
    """The distance in the middle; one of few samples is worth less: half a recording fits in more places than all."""
    return fit.median_mm * most / fit.n_samples


_GIVEN_S = 0.15
"""An offset that is given is known so well."""

_SAME_S = 0.1
"""Fits closer together are one: proposals run into the same."""

_INSIDE = 0.999
"""Of the reach: a fit that ends at the end of it has not ended."""


def _errors(best: Placement, ours: Clocked, theirs: MarkerJoints) -> tuple[float, float, float]:
    """Standard errors of offset (s), rotation (deg) and position (mm), by the jackknife over joints.

    Samples of one joint are not independent of one another; joints nearly are.
    """
    n_joints = ours.points.shape[1]
    middle = np.nanmean(ours.points, axis=(0, 1))
    rows = []
    for left_out in range(n_joints):
        kept = [joint for joint in range(n_joints) if joint != left_out]
        start = Placement(best.offset_s, best.rotation, best.translation_m, best.beside_m[kept])
        fit = refined(Clocked(ours.times_s, ours.points[:, kept]), theirs.chosen(kept), start)
        if fit is None:
            return float("nan"), float("nan"), float("nan")
        turn = Rotation.from_matrix(fit.rotation @ best.rotation.T).as_rotvec(degrees=True)
        shift = fit.in_their_world(middle) - best.in_their_world(middle)
        rows.append([fit.offset_s - best.offset_s, *turn, *(1000 * shift)])
    spread = np.array(rows) - np.mean(rows, axis=0)
    variance = (n_joints - 1) / n_joints * (spread**2).sum(axis=0)
    return float(variance[0] ** 0.5), float(variance[1:4].sum() ** 0.5), float(variance[4:].sum() ** 0.5)
