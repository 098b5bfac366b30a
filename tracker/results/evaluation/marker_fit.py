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
"""Distance beyond which a sample only says that it does not fit, metres; half of an upper arm."""

_N_DRAWS = 300
"""Draws of three samples each: with probability 1 - 1e-17 one of them is right though half of the samples are wrong."""

_N_JUDGES = 600
"""Samples that rank the draws."""


def by_triples(mine: Array, other: Array) -> tuple[Array, Array]:
    """Rotation and translation that most samples support, of random triples (the same in every call)."""
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
"""Least number of joints in frames; seven unknowns have at least twice as many coordinates."""

NOISE_M = 0.003
"""Distances below the noise of markers on cloth do not rank one sample above another."""

_NEAR = 2.0
"""Samples within this many medians of the distance count as deciding."""

_TAILS = 3.0
"""Degrees of freedom of Student's distribution of a joint's samples: an arm may be lost for a while."""

_MEDIAN_OF_THREE = 2.366
"""Median of the sum of the squares of three normal deviates (chi square)."""

_LOST_M = 0.06
"""Standard deviation, in each direction, above which a joint counts for nothing, if three others are three times as
steady. An arm turned about its shoulder by 30 to 170 degrees still shifted the rotation by 0.03 degrees."""

_BESIDE_TAILS = 2.0
"""The same for distances of joints from their markers: no marker set shows where a body's pelvis is (80 mm)."""

_BESIDE_M = 0.015
"""Standard deviation of a joint's centre about the middle of its markers, in each direction: half a wrist."""

_INDEPENDENT = 10
"""Moments of a recording with independent information about a joint's distance from its markers."""

_N_STEPS = 100
"""Largest number of steps of the robust fit; it takes fifteen to sixty, more only if an arm is wrong for a while."""

_STILL = 1e-6
"""Radians, metres and seconds below which a step of the fit has ended."""

REACH_S = 0.5
"""Largest change of the time by a fit: on a track with a lost arm, angles have given it to 0.3 s."""

_STRIDE_S = 0.05
"""Largest change by one step: the markers' movement is linear only nearby."""


@dataclass(frozen=True)
class Placement:
    """The marker system's clock and world against ours: ``t_marker = t + offset``, ``x_marker = R x + t``."""

    offset_s: float
    """Time of the marker clock minus ours, seconds."""

    rotation: Array
    """(3, 3) marker world from ours."""

    translation_m: Array
    """(3,) marker world from ours."""

    beside_m: Array
    """(J, C) our joint centre minus the middle of its markers, in the axes that turn with them and with the bone."""

    median_mm: float = float("nan")
    """Median distance between the joints of both, millimetres."""

    deciding: float = float("nan")
    """Share of the deciding samples: those within two medians."""

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
    """Motion and offset of least robust distance near an offset; None if both share too little."""
    found = _samples(ours, theirs, near_s)
    if len(found.mine) < _LEAST_SAMPLES:
        return None
    rotation, translation = by_triples(found.mine, found.other)
    start = Placement(near_s, rotation, translation, np.zeros(theirs.frames.shape[1::2]))
    return refined(ours, theirs, start, reach_s)


def refined(ours: Clocked, theirs: MarkerJoints, start: Placement, reach_s: float = REACH_S) -> Placement | None:
    """Maximum likelihood of twist, time, and each joint's place beside its markers, with a spread for each joint.

    A joint's samples follow Student's distribution about their place, with an estimated spread (EM: Lange, Little and
    Taylor, JASA 1989). A limb in a wrong place then counts little, however near it is; a joint that is far beside its
    markers, but constantly so, counts much. With one scale for all samples a displaced arm shifted the alignment by up
    to 12 deg and 78 mm; with these by 1.5 deg and 14 mm: docs/lab/marker_alignment.md.

    Args:
        ours: (T, J) joints of a track.
        theirs: the same joints of markers.
        start: initial placement.
        reach_s: largest change of the offset, seconds.

    Returns:
        The placement; None if both share too little.
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
    """(J,) variance of the joints' samples in each direction, square metres, at least the markers' noise.

    At first about each joint's usual place beside its markers: a joint far beside them counts, too.
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
    """Weight of a sample against one in the middle of its joint's distribution."""
    share: Array = (_TAILS + 3) / (_TAILS + square / variance)
    return share


def _weights(found: _Samples, residual: Array, variances: Array, n_frames: int) -> Array:
    """(N,) roots of the samples' weights, 1/m."""
    variance = variances[found.joint]
    # Samples of one joint err alike for a while: all of a recording weigh as `_INDEPENDENT` moments do.
    alike = min(1.0, _INDEPENDENT / n_frames)
    weight: Array = np.sqrt(alike * _share((residual**2).sum(axis=1), variance) / variance)
    steady = np.sort(variances[np.unique(found.joint)])[:3].max()
    weight[variance > max(_LOST_M**2, 9 * steady)] = 0.0
    return weight


def _step(found: _Samples, now: Placement, shifts: tuple[bool, ...], residual: Array, weight: Array) -> Array:
    """(7 + J C,) rotation vector, translation, offset and shifts that reduce the weighted distances most."""
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
"""Fewer do not show the turn between the worlds."""

_NEARLY = 1.5
"""Times the median distance: another push-up may have as much."""


@dataclass(frozen=True)
class Alignment:
    """A placement, and its uncertainty."""

    placement: Placement

    correlation: float
    """Correlation of the flexion angles at the offset that they proposed; NaN if the offset was given."""

    rival_offset_s: float
    """Another offset that fits nearly as well, as with periodic movement; NaN if none does."""

    offset_sigma_s: float
    """Standard error by leaving out one joint after another: it includes a fault of one joint."""

    rotation_sigma_deg: float
    """The same of the rotation."""

    position_sigma_mm: float
    """The same of the position of the joints' middle."""


def align(
    ours: Clocked, theirs: MarkerJoints, hinges: list[tuple[int, int, int]], offset_s: float | None = None
) -> Alignment:
    """Finds the position of a marker recording against a track of the same movement.

    The correlation of the hinges' flexion, which no frame of reference changes, proposes the time. For each proposal,
    random triples of samples give a rigid motion; a fit then refines motion and time together, with weights that ignore
    a lost arm. The best proposal wins.

    Args:
        ours: joints of the track.
        theirs: the same joints, from markers.
        hinges: columns of the joint before, the hinge, and the joint behind.
        offset_s: the offset if it is known within a tenth of a second; None to find it.

    Raises:
        SequenceError: nothing in common, or a movement that shows no offset.
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
    """Cost: the median distance; few samples cost more, because half a recording fits in more places."""
    return fit.median_mm * most / fit.n_samples


_GIVEN_S = 0.15
"""Accuracy of a given offset, seconds."""

_SAME_S = 0.1
"""Fits closer together are one: several proposals lead to it."""

_INSIDE = 0.999
"""Share of the reach: a fit that ends at its limit has not converged."""


def _errors(best: Placement, ours: Clocked, theirs: MarkerJoints) -> tuple[float, float, float]:
    """Standard errors of offset (s), rotation (deg) and position (mm), by the jackknife over joints.

    Samples of one joint depend on one another; joints hardly do.
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
