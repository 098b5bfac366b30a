"""Decides by the images between two poses of a person: one comparison for all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tracker.bodies.limbs import are_apart
from tracker.foundation.arrays import Array
from tracker.tracking.estimate import Estimate
from tracker.tracking.objective import Objective

# On two recordings a smaller lead went from the right pose to a wrong one three times, and never back; a larger one did
# so once of seven times. See docs/lab/defaults_with_plates.md and docs/lab/one_comparison.md.
LEAD_PX = 0.1
"""Lead of a pose with limbs in other places, px: more than a refinement from another start gains."""


def explains_better(objective: Objective, q: Array, other: Array) -> bool:
    """Whether the images support another pose (dof,) more than the present one (dof,).

    With limbs in the same places the distance alone decides; with limbs in other places the colours of parts count as
    well, and the other pose must lead by `LEAD_PX`.
    """
    poses = np.array([q, other])
    if not are_apart(objective.body, other, q):
        mine, theirs = objective(poses)
        return bool(theirs < mine)
    mine, theirs = objective.deciding_px(poses)
    return bool(theirs < mine - LEAD_PX)


def likelier(objective: Objective, mine: Estimate, other: Estimate) -> Estimate:
    """The estimate that the images support, with the evaluations of both; see `explains_better`."""
    if other is mine:
        return mine
    best = other if explains_better(objective, mine.q, other.q) else mine
    return replace(best, evaluations=mine.evaluations + other.evaluations)
