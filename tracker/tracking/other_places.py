"""Searches for limbs of a pose wherever they may be; accepts a pose if the images support it."""

from __future__ import annotations

import time
from collections.abc import Collection
from dataclasses import replace

from tracker.bodies.limbs import are_apart
from tracker.tracking.estimate import Estimate
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.objective import Objective
from tracker.tracking.proposals import elsewhere, tried

# How often all limbs are looked for: of two arms that cross, one is found when the other one is.
_ROUNDS = 2

_REFINEMENT = TwistIcpEstimation()


def in_likeliest_places(objective: Objective, estimate: Estimate, limbs: Collection[str] | None = None) -> Estimate:
    """The estimate, perhaps with limbs elsewhere, if contours and the colours of parts together support them.

    Estimations search limbs with poor contours; a limb in the wrong place may have good ones, see
    `Objective.nats`. Four limbs take 0.4 s of CPU a start (simulated squat, 720x576).

    Args:
        objective: of the frame, with the other persons where they are.
        estimate: of a person whose trunk is right.
        limbs: limbs to search for, or a head; None for all limbs.
    """
    body = objective.body
    sought = [group for group in body.fine_groups if group in (body.limbs if limbs is None else limbs)]
    if estimate.lost or not sought:
        return estimate
    begin, best = time.perf_counter(), estimate
    for _ in range(_ROUNDS):
        before = best
        for limb in sought:
            found = tried(objective, best, limb, elsewhere.propose, _REFINEMENT)
            # a limb that returns to the same place is not elsewhere: it would only follow a body that does not fit
            best = found if are_apart(body, found.q, best.q, body.landmarks_of(limb)) else best
        if best.q is before.q:
            break
    return replace(best, search_s=estimate.search_s + time.perf_counter() - begin)
