"""A marker system's clock and world against ours: time by joint angles, then time and space by one robust fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.foundation.errors import SequenceError
from tracker.results.evaluation.marker_fit import NOISE_M, REACH_S, Placement, placed, refined
from tracker.results.evaluation.marker_set import MarkerJoints
from tracker.results.evaluation.time_correlation import Clocked, offsets_by_angles

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
