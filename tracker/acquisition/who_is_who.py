"""Which of several persons is which, by the bodies that were fitted to them.

At the start that is told by how high heads are. Somebody who lies or kneels is then taken for the smallest: a scanned
man of 1.85 m who gets up beside a woman of 1.73 m was tracked by her name, and with a body between the two.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.acquisition.result import stature_of
from tracker.bodies.body import BodyModel

_HELD_BACK = 2.5
"""How much farther from the stature that is told a fitted one may be if nothing is told, at most: bodies fitted under
each other's names went 22, 54, 70 and 71 % of the way to the right stature."""

_BY_M = 0.03
"""By how much less all statures must differ from those told to others before that is tried. Six fitted under the right
names were 1 to 15 mm off."""


def whose(told: Sequence[BodyModel], fitted: Mapping[int, BodyModel]) -> tuple[int, ...] | None:
    """For each person the place of who seems to be that one; None if everybody seems to be in its own.

    Args:
        told: the persons' bodies as models and statures have them.
        fitted: place -> the body fitted. Those without one, and bodies of other models, stay who they are.
    """
    order = list(range(len(told)))
    for names in {told[k].names for k in fitted}:
        alike = [k for k in fitted if told[k].names == names]
        wanted, found = (np.array([stature_of(bodies[k]) for k in alike]) for bodies in (told, fitted))
        low, high = np.sort([found, wanted + _HELD_BACK * (found - wanted)], axis=0)
        costs = np.maximum(np.maximum(low - wanted[:, None], wanted[:, None] - high), 0.0)
        rows, columns = linear_sum_assignment(costs)
        if np.trace(costs) - costs[rows, columns].sum() > _BY_M:
            for row, column in zip(rows, columns, strict=True):
                order[alike[row]] = alike[column]
    return tuple(order) if order != list(range(len(told))) else None


def apart_m(told: Sequence[BodyModel], fitted: Mapping[int, BodyModel], whom: Set[int]) -> float:
    """Mean distance of the fitted statures of some persons to those told, metres; inf where one has no fitted body."""
    if not whom <= fitted.keys():
        return float("inf")
    return float(np.mean([abs(stature_of(fitted[k]) - stature_of(told[k])) for k in whom]))
