"""Search where it is needed, refinement always: the default estimation."""

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
    """Refines the candidate predictions; where the best one leaves contours unexplained, searches first.

    Refinement alone is safe to about 3 degrees and 2 cm and ten times cheaper than the search; the search
    covers the paper's range of 15 degrees and 10 cm.
    """

    first: Estimation = BestFirstEstimation()
    """The search."""

    then: Estimation = TwistIcpEstimation()
    """The refinement."""

    search: bool = False
    """Search in every frame, as the paper does; else only where the refined prediction explains too little."""

    search_below: float = pydantic.Field(default=0.75, ge=0, le=1)
    """Share of the visible contour that must lie on scene edges for the search to be skipped."""

    def estimate(self, objective: Objective, starts: Array) -> Estimate:
        """The best of the refined predictions and, where needed, of the refined search result."""
        refined = self.then.estimate(objective, starts)
        if not self.search and refined.explained >= self.search_below:
            return refined
        searched = self.first.estimate(objective, np.concatenate([starts, refined.q[None]]))
        again = self.then.estimate(objective, searched.q[None])
        return again if again.distance_px < refined.distance_px else refined
