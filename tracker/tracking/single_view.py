"""Limbs of which only one view shows a part: it hardly shows their depth, and other places may fit as well."""

from __future__ import annotations

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.limbs import are_apart, scattered
from tracker.foundation.arrays import Mask
from tracker.tracking.doubt import Because, Doubt
from tracker.tracking.estimate import Estimate
from tracker.tracking.objective import Objective

# One view alone shows a part if the view that shows second most has less of its contour than this share of the first.
# A few px at a joint, added to both, are nothing to go by.
_SHARE, _FEW_PX = 0.4, 10.0
# Links of a limb, thigh and shin, that tell where it is.
_FEW = 2
# Places that are tried, and how far around the one found: standard deviations of angles, rad, and translations, m.
# A person's elbow gets 10 to 50 cm away.
_TRIED, _SPREAD = 96, (np.radians(25.0), 0.1)


def with_vague_limbs(objective: Objective, estimate: Estimate, within_px: float) -> Estimate:
    """The estimate, with such limbs vague if another place fits as well.

    The sigmas of a pose (`loss.limb_spreads_m`) say how far one may move it, not where else it may be. In martial arts
    filmed by two cameras an upper arm is visible to the one behind the man, and his chest hides it from the other one.
    Elbow and wrist were 20 and 13 cm off in depth for 25 frames, with sigmas below 6 cm; the true pose left over as
    much, to 0.06 px.

    Args:
        objective: of the frame, with the other persons where they are.
        estimate: judged already.
        within_px: extra cost up to which another place fits; 0 for none.
    """
    body = objective.body
    if estimate.lost or within_px == 0:
        return estimate
    limbs = (group for group in body.limbs if group not in estimate.ambiguous)
    shown = [group for group in limbs if _shown_by_one(estimate, _telling(body, group))]
    costs_px = {group: _least_elsewhere_px(objective, estimate, group) for group in shown}
    vague = {group: cost_px for group, cost_px in costs_px.items() if cost_px < within_px}
    return estimate.doubting(Doubt(group, Because.TWO_POSES, cost_px, within_px) for group, cost_px in vague.items())


def _telling(body: BodyModel, group: str) -> Mask:
    """(P,) parts of a limb that show its place: not the last of three links or more, hands and feet.

    Only one view often shows these, and their forearms and shins show their places. With them the same frames of four
    recordings by two cameras are flagged.
    """
    parts = np.flatnonzero(body.parts_of(group))
    n_moving = body.moves[:, body.part_parameters[parts]].sum(axis=0)
    links = np.unique(n_moving)
    telling = np.zeros(len(body.parts), dtype=np.bool_)
    telling[parts[n_moving < links[-1]] if len(links) > _FEW else parts] = True
    return telling


def _shown_by_one(estimate: Estimate, parts: Mask) -> bool:
    """Whether only one view shows one of some parts (P,); False for evidence without views."""
    if estimate.account.by_view_px is None:
        return False
    visible_px = np.sort(estimate.account.by_view_px[0][:, parts], axis=0)
    second = visible_px[-2] if len(visible_px) > 1 else np.zeros_like(visible_px[-1])
    return bool((second + _FEW_PX < _SHARE * (visible_px[-1] + _FEW_PX)).any())


def _least_elsewhere_px(objective: Objective, estimate: Estimate, group: str) -> float:
    """Extra cost of the best other place of a limb, px."""
    body: BodyModel = objective.body
    poses = scattered(body, estimate.q[None], group, _TRIED, _SPREAD)
    poses = poses[are_apart(body, poses, estimate.q, body.landmarks_of(group))]
    distances = objective(np.concatenate([estimate.q[None], poses]))
    return float(distances[1:].min(initial=np.inf) - distances[0])
