"""Neighbouring starts: refines limbs scattered around the pose found as well, and keeps the best pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pydantic

from tracker.bodies.limbs import scattered
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.tracking.estimate import Estimate
from tracker.tracking.estimation import Estimation
from tracker.tracking.estimation.hybrid import HybridEstimation
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.limb_probabilities import left_over_of
from tracker.tracking.objective import Objective
from tracker.tracking.verdict import likelier


@component
class NeighboursEstimation:
    """Starts from neighbouring poses, too (Rosenhahn et al. 2006, section 2.3), one limb after the other.

    The paper refines every neighbour, and keeps the one of least error. Here those of a limb are compared together,
    because parts that stand still are drawn once, and the best of them refined.

    Not the default: it leads out of local minima, and into others. On three recordings a joint was 150 mm off in 32
    frames in place of 23 (docs/lab/defaults_with_plates.md). In 11 of these 23 the right pose, refined, had less
    distance than the wrong one, in 8 of them by 0.1 px; in the others no search can find it.
    """

    of: Estimation = HybridEstimation()
    """Finds the pose whose neighbours are tried."""

    then: Estimation = TwistIcpEstimation()
    """Refines them."""

    scattered: int = pydantic.Field(default=32, ge=1)
    """Neighbours of each limb, equally many around the pose found, the predictions and the last pose."""

    refined: int = pydantic.Field(default=2, ge=1)
    """Number of them that are refined, the best ones first."""

    spread_deg: float = pydantic.Field(default=15.0, gt=0)
    """Standard deviation of their angles, degrees."""

    spread_m: float = pydantic.Field(default=0.1, gt=0)
    """The same of translations, metres."""

    above: float = pydantic.Field(default=0.1, ge=0)
    """Left-over share of a limb above which its neighbours are tried."""

    def estimate(self, objective: Objective, starts: Array) -> Estimate:
        """The best of the pose found and its refined neighbours."""
        found, body = self.of.estimate(objective, starts), objective.body
        best = found
        for group in body.limbs:
            if left_over_of(best.account.of(body.parts_of(group))) > self.above:
                best = self._best_neighbour(objective, best, starts, group)
        return replace(best, search_s=found.search_s, vain=found.vain)

    def _best_neighbour(self, objective: Objective, estimate: Estimate, starts: Array, group: str) -> Estimate:
        """The estimate, or a refined neighbour that is clearly better."""
        centres, spread = np.concatenate([estimate.q[None], starts]), (np.radians(self.spread_deg), self.spread_m)
        near = scattered(objective.body, centres, group, self.scattered, spread)
        ranked = near[np.argsort(objective(near), kind="stable")[: self.refined]]
        refined = self.then.estimate(objective, ranked)
        return likelier(objective, estimate, replace(refined, evaluations=refined.evaluations + len(near)))
