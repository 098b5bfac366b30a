"""Limbs that may be anywhere, of a start or long in doubt: put where contours and colours of parts speak for them."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.limbs import apart_m, are_apart
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.geometry.halton import halton
from tracker.tracking.estimate import Estimate
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.objective import Objective

# Places of a limb over all its joints allow; how many of the nearest ones are looked at for colours, and how many of
# these refined. Four limbs take 0.4 s of CPU a start (simulated squat, 720x576): in every frame of a run that would be
# dear, so there it is done for limbs long in doubt alone.
_TRIED, _LOOKED_AT, _REFINED = 600, 24, 6
# What a place may cost more than the one found before it is refined, and after, px. That of a leg that was put into the
# other one, where it has no contour to be wrong, costs 1.05 px less than the true one; colours are worth 17 px there.
# See docs/lab/part_colours.md.
_PROMISING_PX, _WITHIN_PX = 2.5, 1.5
# Limits that leave a joint less than this leave its limb about where it is.
_WIDE_RAD = np.radians(89.0)
# How often all limbs are looked for: of two arms that cross, one is found when the other one is.
_ROUNDS = 2

_LEAD_PX = 0.05
"""What another place must be better by: more than a refinement that begins elsewhere gains in the same place."""

_REFINEMENT = TwistIcpEstimation()


def in_likeliest_places(
    objective: Objective, estimate: Estimate, limbs: Collection[str] | None = None, lead_px: float = _LEAD_PX
) -> Estimate:
    """The estimate, perhaps with limbs elsewhere: where contours and the colours of parts together speak for them.

    Estimations search limbs whose contours are poor; those of a limb in the wrong place need not be, see
    `Objective.deciding_px`.

    Args:
        objective: of the frame, with the other persons where they are.
        estimate: of a person whose trunk is found.
        limbs: those that are looked for, or a head; None for all limbs.
        lead_px: what another place must be better by, px.
    """
    body = objective.body
    sought = [group for group in body.fine_groups if group in (body.limbs if limbs is None else limbs)]
    if estimate.lost or objective.colours is None or not sought:  # a rigid end in doubt alone: nothing moves it
        return estimate
    begin = time.perf_counter()
    best, least_px = estimate, float(objective.deciding_px(estimate.q[None])[0])
    n_evaluations = estimate.evaluations
    for _ in range(_ROUNDS):
        before = best
        for group in sought:
            for one in _elsewhere(objective, best, group):
                n_evaluations += one.evaluations
                if (cost_px := float(objective.deciding_px(one.q[None])[0])) < least_px - lead_px:
                    best, least_px = one, cost_px
        if best is before:
            break
    search_s = estimate.search_s + time.perf_counter() - begin
    return replace(best, search_s=search_s, evaluations=n_evaluations)


def _elsewhere(objective: Objective, estimate: Estimate, group: str) -> Iterator[Estimate]:
    """Refined poses that cost hardly more, with a limb elsewhere."""
    body, marks = objective.body, objective.body.landmarks_of(group)
    poses = _over_all_places(body, estimate.q, group)
    distances = objective(poses)
    order = np.argsort(distances, kind="stable")
    promising = poses[order[distances[order] < estimate.distance_px + _PROMISING_PX]]
    different = _different(body, promising, group)
    for q in different[np.argsort(objective.deciding_px(different), kind="stable")[:_REFINED]]:
        refined = _REFINEMENT.estimate(objective, q[None])
        near = refined.distance_px < estimate.distance_px + _WITHIN_PX
        if near and are_apart(body, refined.q, estimate.q, marks):
            yield refined


def _over_all_places(body: BodyModel, q: Array, group: str) -> Array:
    """(N, dof) poses with a limb everywhere its wide joints allow; narrow ones and its end are as usual."""
    columns = body.group(group)
    wide = columns[_leads_far(body, columns, group)]
    if not len(wide):
        return np.empty((0, body.dof))
    low, high = body.limits[wide].T
    poses = np.tile(q, (_TRIED, 1))
    poses[:, columns] = body.rest()[columns]
    poses[:, wide] = low + halton(_TRIED, len(wide)) * (high - low)
    return poses


def _leads_far(body: BodyModel, columns: Integers, group: str) -> Mask:
    """(N,) whether parameters of a limb turn far, and more than its last part alone."""
    parts = np.flatnonzero(body.parts_of(group))
    moves = body.moves[np.ix_(columns, body.part_parameters[parts])]
    wide = np.ptp(body.limits[columns], axis=1) > _WIDE_RAD
    far: Mask = wide & ((moves.sum(axis=1) > 1) | (len(parts) == 1))
    return far


def _different(body: BodyModel, poses: Array, group: str) -> Array:
    """The first (n, dof) of some poses (N, dof) whose limbs are in different places."""
    joints = body.landmarks_in_world(poses)[:, body.landmarks_of(group)]
    left = np.arange(len(poses))
    chosen: list[int] = []
    while len(left) and len(chosen) < _LOOKED_AT:
        chosen.append(int(left[0]))
        gaps = np.linalg.norm(joints[left] - joints[left[0]], axis=2).max(axis=1, initial=0.0)
        left = left[gaps > apart_m(body)]
    different: Array = poses[chosen]
    return different
