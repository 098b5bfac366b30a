"""Weighs a pose from another way against the present one, as a whole and limb by limb."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tracker.bodies.limbs import are_apart, taken_over
from tracker.foundation.arrays import Array, Mask
from tracker.tracking.estimate import Estimate
from tracker.tracking.objective import Objective
from tracker.tracking.verdict import explains_better


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
