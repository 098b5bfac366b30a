"""The probability that a limb is right."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.limbs import smallness
from tracker.evidence.measures.account import Account
from tracker.foundation.arrays import Array, Mask
from tracker.tracking.doubt import Because
from tracker.tracking.estimate import Estimate

_KNOWN_M, _LEAST_SPREAD_M = 0.03, 0.003
"""Spread of a joint that changes no probability, and least spread that counts, metres."""

_STOP_RAD, _NARROW_RAD = np.radians(1.0), np.radians(20.0)
"""Tolerance for an angle at its limit, and range of an angle that hardly moves, rad."""


# A limb that shows less contour than this over all views is judged as if it showed so much, px.
_LEAST_LIMB_PX = 100.0
# Hair leaves over 0.03 to 0.27 of a right head, and 0.60 of one that a start had bent forward. See
# docs/lab/acquired_starts.md.
_USUAL_OF_HEADS = 0.2


class Odds(NamedTuple):
    """Two things may be wrong: the pose as a whole, or a single limb. Log odds that each is right."""

    whole: float
    """Of a pose that leaves nothing over, with joints known to 3 cm."""

    whole_left_over: float
    """Reduction by the squared left-over share of the whole body."""

    whole_vague: float
    """Reduction by the logarithm of a joint's spread over 3 cm."""

    whole_stops: float
    """Reduction by each angle at its limit."""

    limb: float
    """Of a limb that leaves nothing over, in a right pose."""

    limb_left_over: float
    """Reduction by the limb's left-over share."""

    limb_jump: float
    """What a jump to or from where the limb is takes from them."""


# Fitted by scripts/fit_doubt.py to 17 804 limbs, 735 of them 150 mm off; the jump to 6112 others, 725 of them off. See
# docs/lab/probability_of_limbs.md and docs/lab/path_of_limbs.md.
FITTED = Odds(
    whole=4.45,
    whole_left_over=87.4,
    whole_vague=3.78,
    whole_stops=1.38,
    limb=10.6,
    limb_left_over=22.2,
    limb_jump=6.0,
)


class Known(NamedTuple):
    """Data of a run on N limbs, each (N,)."""

    left_over: Array
    """Left-over share of the limb's contour, see `tracker.tracking.loss.limbs_left_over`."""

    whole_left_over: Array
    """The same of the whole body."""

    spread_m: Array
    """Spread of the limb's joints, see `limb_spreads_m`; NaN if unknown."""

    stops: Array
    """Number of angles of the limb, and of trunk and head, at a limit: persons are seldom there."""

    jumped: Array
    """1 where the limb jumps to another place or from one, see `tracker.tracking.jumps`, else 0."""


def known_of(body: BodyModel, estimate: Estimate) -> Known:
    """Data on the limbs of a body, in the order of `body.limbs`; spreads are scaled to a person's size."""
    left_over, spreads_m = limbs_left_over(body, estimate.account), limb_spreads_m(body, estimate)
    found = np.array([spreads_m[limb] for limb in body.limbs]) / smallness(body)
    if not np.isfinite(estimate.covariance).all():
        found = np.full(len(body.limbs), np.nan)
    whole = np.full(len(body.limbs), estimate.account.left_over)
    stops = at_limits(body, estimate.q)
    trunk = np.setdiff1d(np.arange(body.dof), [column for limb in body.limbs for column in body.group(limb)])
    n_stops = [int(stops[body.group(limb)].sum() + stops[trunk].sum()) for limb in body.limbs]
    jumped = np.array([Because.JUMP in estimate.because(limb) for limb in body.limbs], dtype=np.float64)
    return Known(np.array([left_over[limb] for limb in body.limbs]), whole, found, np.array(n_stops), jumped)


def at_limits(body: BodyModel, q: Array) -> Mask:
    """(dof,) angles of a pose (dof,) at a limit, except those that can hardly move."""
    low, high = body.limits.T
    near = (q < low + _STOP_RAD) | (q > high - _STOP_RAD)
    found: Mask = body.rotates & (high - low > _NARROW_RAD) & np.isfinite(high - low) & near
    return found


def right_by(odds: Odds, known: Known) -> Array:
    """(N,) probability that all joints of a limb are within 150 mm of their true places, 0 to 1."""
    vague = np.nan_to_num(np.log(np.maximum(known.spread_m, _LEAST_SPREAD_M) / _KNOWN_M))
    whole = odds.whole - odds.whole_left_over * known.whole_left_over**2 - odds.whole_vague * vague
    whole -= odds.whole_stops * known.stops
    limb = odds.limb - odds.limb_left_over * known.left_over - odds.limb_jump * known.jumped
    right: Array = _sigmoid(whole) * _sigmoid(limb)
    return right


def limb_probabilities(body: BodyModel, estimate: Estimate) -> dict[str, float]:
    """Limb -> probability that all its joints are within 150 mm of their true places, 0 to 1."""
    right = right_by(FITTED, known_of(body, estimate))
    return dict(zip(body.limbs, right.tolist(), strict=True))


def _sigmoid(log_odds: Array) -> Array:
    share: Array = 0.5 * (1.0 + np.tanh(0.5 * log_odds))
    return share


def limbs_left_over(body: BodyModel, account: Account) -> dict[str, float]:
    """Limb -> left-over share of its contour, see `left_over_of`; head and tail with their unusual angles."""
    # The trunk carries the limbs; its left-over contour is that of clothes.
    usual = dict.fromkeys(body.doubted_ends, _USUAL_OF_HEADS) | dict.fromkeys(body.limbs, 0.0)
    return {group: max(left_over_of(account.of(body.parts_of(group))) - usual[group], 0.0) for group in usual}


def limb_spreads_m(body: BodyModel, estimate: Estimate) -> dict[str, float]:
    """Limb -> largest standard deviation of its joints, each in its least known direction, metres.

    0 if the estimation gave no covariance.
    """
    spreads = np.zeros(len(body.landmarks))
    if np.isfinite(estimate.covariance).all():
        points = body.landmarks_in_world(estimate.q)
        ends = np.array([mark.parameter for mark in body.landmarks])
        moved = body.point_jacobian(estimate.q, points, ends)
        variances = np.linalg.eigvalsh(moved @ estimate.covariance @ moved.transpose(0, 2, 1))[:, -1]
        spreads = np.sqrt(np.maximum(variances, 0.0))
    return {limb: float(spreads[body.landmarks_of(limb)].max(initial=0.0)) for limb in body.limbs}


def left_over_of(limb: Account) -> float:
    """Left-over share of a limb's contour; for a limb hardly seen, of the least contour that it should show."""
    visible_px = max(float(limb.visible_px.sum()), _LEAST_LIMB_PX)
    return float(limb.left_over_px.sum()) / visible_px
