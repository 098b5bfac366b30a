"""Decides by the images between two poses of a person, as a whole and limb by limb: one comparison for all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tracker.bodies.limbs import are_apart, taken_over
from tracker.foundation.arrays import Array, Mask
from tracker.tracking.estimate import Estimate
from tracker.tracking.objective import Objective

# On two recordings a smaller lead went from the right pose to a wrong one three times, and never back; a larger one did
# so once of seven times. See docs/lab/defaults_with_plates.md and docs/lab/one_comparison.md.
LEAD_NATS = 0.3
"""Lead of a pose with limbs in other places, nats: more than a refinement from another start gains."""


def explains_better(objective: Objective, q: Array, other: Array) -> bool:
    """Whether the images support another pose (dof,) more than the present one (dof,).

    With limbs in the same places the distance alone decides; with limbs in other places the colours of parts count as
    well, and the other pose must lead by `LEAD_NATS`.
    """
    poses = np.array([q, other])
    if not are_apart(objective.body, other, q):
        mine, theirs = objective(poses)
        return bool(theirs < mine)
    mine, theirs = objective.nats(poses)
    return bool(theirs < mine - LEAD_NATS)


def likelier(objective: Objective, mine: Estimate, other: Estimate) -> Estimate:
    """The estimate that the images support, with the evaluations of both; see `explains_better`."""
    if other is mine:
        return mine
    best = other if explains_better(objective, mine.q, other.q) else mine
    return replace(best, evaluations=mine.evaluations + other.evaluations)


def weighed(objective: Objective, mine: Estimate, rival: Estimate) -> Estimate:
    """Combines two estimates of the same person in the same frame.

    The errors of two ways to a pose hardly coincide, nor do those of its limbs: one has an arm right, the other a leg.

    Args:
        objective: judges both by the same images.
        mine: the present estimate; kept unless the other is clearly better.
        rival: from another way.

    Returns:
        The one that explains the images better, perhaps with limbs of the other one.
    """
    body = objective.body
    best, other = (rival, mine) if explains_better(objective, mine.q, rival.q) else (mine, rival)
    q, theirs = best.q, np.zeros(body.dof, dtype=np.bool_)
    limbs = [group for group in body.limbs if are_apart(body, mine.q, rival.q, body.landmarks_of(group))]
    for group in limbs:
        mixed = taken_over(body, q, other.q, group)
        if explains_better(objective, q, mixed):
            q = mixed
            theirs[body.group(group)] = True
    if q is mine.q:
        return mine
    covariance = _of_both(best.covariance, other.covariance, theirs)
    found = objective.estimate(q, covariance, mine.evaluations + 2 + len(limbs))
    return replace(found, search_s=mine.search_s, vain=mine.vain)


def _of_both(one: Array, other: Array, theirs: Mask) -> Array:
    """(dof, dof) covariance of a pose with some parameters of another one, which are independent of the rest."""
    same = theirs[:, None] == theirs[None, :]
    covariance: Array = np.where(same, np.where(theirs[:, None], other, one), 0.0)
    return covariance
