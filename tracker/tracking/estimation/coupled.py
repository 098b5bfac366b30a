"""Segmentation and pose estimation in turn (Rosenhahn et al. 2006, eq. 4): each starts from the other's result."""

from __future__ import annotations

from dataclasses import replace

import pydantic

from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.tracking.estimate import Estimate
from tracker.tracking.estimation import Estimation
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.objective import Objective


@component
class CoupledEstimation:
    """Estimates the pose, observes the images again with that pose as their prior, and estimates it anew.

    Only evidence whose observation depends on the pose gains by it: level sets. Other evidence observes twice.
    """

    of: Estimation = TwistIcpEstimation()
    """Estimates the pose from an observation."""

    rounds: int = pydantic.Field(default=2, ge=1)
    """Number of alternations between contour and pose."""

    def estimate(self, objective: Objective, starts: Array) -> Estimate:
        """The pose of the last round; its account is from the last observation."""
        estimate = self.of.estimate(objective, starts)
        for _ in range(self.rounds - 1):
            objective = objective.observed_again(estimate.q)
            again = self.of.estimate(objective, estimate.q[None])
            counted, spent = again.evaluations + estimate.evaluations, again.search_s + estimate.search_s
            estimate = replace(again, evaluations=counted, search_s=spent, vain={**estimate.vain, **again.vain})
        return estimate
