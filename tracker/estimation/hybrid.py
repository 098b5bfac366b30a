"""Refinement always, search where it is needed: the default estimation."""

from __future__ import annotations

import numpy as np
import pydantic

from tracker.arrays import Array
from tracker.components import component
from tracker.estimate import Estimate
from tracker.estimation import Estimation
from tracker.estimation.best_first import BestFirstEstimation
from tracker.estimation.twist_icp import TwistIcpEstimation
from tracker.objective import Objective


@component
class HybridEstimation:
    """Refines the candidate predictions; limbs whose contour stays unexplained are searched and refined again.

    Refinement alone is safe to about 3 degrees and 2 cm and ten times cheaper than the search, which covers the
    paper's range of 15 degrees and 10 cm.
    """

    first: Estimation = BestFirstEstimation()
    """The search of the whole pose."""

    limb: BestFirstEstimation = BestFirstEstimation(range_deg=40.0, step_deg=10.0, patience=6)
    """The search of a single limb."""

    then: Estimation = TwistIcpEstimation()
    """The refinement."""

    search: bool = False
    """Search the whole pose in every frame, as the paper does; else only where the refined prediction is poor."""

    search_below: float = pydantic.Field(default=0.7, ge=0, le=1)
    """Share of a group's visible contour on scene edges under which the group is searched."""

    min_visible_px: float = pydantic.Field(default=40.0, ge=0)
    """Groups that show less contour than this over all views are left to the refinement, px."""

    def estimate(self, objective: Objective, starts: Array) -> Estimate:
        """The best of the refined predictions and, where needed, of the refined search results."""
        refined = self.then.estimate(objective, starts)
        weak = self._weak_groups(objective, refined.q)
        if self.search or len(weak) > 2 or objective.body.fine_groups[0] in weak:
            searched = self.first.estimate(objective, np.concatenate([starts, refined.q[None]]))
            again = self.then.estimate(objective, searched.q[None])
            refined = again if again.distance_px < refined.distance_px else refined
            weak = self._weak_groups(objective, refined.q)
        for group in weak:
            columns = objective.body.group(group)
            q, _ = self.limb.search_group(objective, refined.q, columns)
            again = self.then.estimate(objective, q[None])
            refined = again if again.distance_px < refined.distance_px else refined
        return refined

    def _weak_groups(self, objective: Objective, q: Array) -> tuple[str, ...]:
        """Fine groups of the body whose visible contour is explained too little."""
        body = objective.body
        found = objective.evidence(q)
        first = objective.scene.first_part(objective.person)
        own = slice(first, first + len(body.parts))
        visible = found.visible_px[own]
        explained = np.nan_to_num(found.explained[own]) * visible
        weak = []
        for group in body.fine_groups:
            parts = body.parts_of(group)
            length = visible[parts].sum()
            if length >= self.min_visible_px and explained[parts].sum() < self.search_below * length:
                weak.append(group)
        return tuple(weak)
