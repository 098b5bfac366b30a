"""Refinement always, search where it is needed: the default estimation."""

from __future__ import annotations

import numpy as np
import pydantic
from scipy.stats.qmc import Halton

from tracker.arrays import Array, Integers
from tracker.body import BodyModel
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

    search_below: float = pydantic.Field(default=0.55, ge=0, le=1)
    """Share of a group's visible contour on scene edges under which the group is searched."""

    min_visible_px: float = pydantic.Field(default=100.0, ge=0)
    """Groups that show less contour than this over all views are judged as if they showed so much, px."""

    most_limbs: int = pydantic.Field(default=2, ge=0)
    """Where more groups than this are poor, the whole pose is searched first."""

    scatter: int = pydantic.Field(default=96, ge=1)
    """Poses of a limb scattered over its joint limits when it is searched."""

    restarts: int = pydantic.Field(default=2, ge=0)
    """How many of them the search starts from, besides the pose at hand."""

    def estimate(self, objective: Objective, starts: Array) -> Estimate:
        """The best of the refined predictions and, where needed, of the refined search results."""
        refined = self.then.estimate(objective, starts)
        weak = self._weak_groups(objective, refined.q)
        if self.search or len(weak) > self.most_limbs:
            searched = self.first.estimate(objective, np.concatenate([starts, refined.q[None]]))
            again = self.then.estimate(objective, searched.q[None])
            refined = again if again.distance_px < refined.distance_px else refined
            weak = self._weak_groups(objective, refined.q)
        for group in weak:
            again = self._searched_limb(objective, refined.q, group)
            refined = again if again.distance_px < refined.distance_px else refined
        return refined

    def _searched_limb(self, objective: Objective, q: Array, group: str) -> Estimate:
        """A limb searched from where it is and from the best of poses scattered over its joint limits."""
        columns = objective.body.group(group)
        scattered = _scattered(objective.body, q, columns, self.scatter)
        best = scattered[np.argsort(objective(scattered), kind="stable")[: self.restarts]]
        found = [self.limb.search_group(objective, start, columns)[0] for start in (q, *best)]
        return self.then.estimate(objective, np.array(found))

    def _weak_groups(self, objective: Objective, q: Array) -> tuple[str, ...]:
        """Fine groups whose contours the scene explains too little, or that leave too much of the scene unexplained."""
        body = objective.body
        found = objective.evidence(q)
        first = objective.scene.first_part(objective.person)
        own = slice(first, first + len(body.parts))
        visible, missed = found.visible_px[own], found.missed_px[own]
        unexplained = visible * (1 - np.nan_to_num(found.explained[own]))
        weak = []
        for group in body.fine_groups:
            parts = body.parts_of(group)
            allowed = (1 - self.search_below) * max(float(visible[parts].sum()), self.min_visible_px)
            if (unexplained + missed)[parts].sum() > allowed:
                weak.append(group)
        return tuple(weak)


def _scattered(body: BodyModel, q: Array, columns: Integers, n: int) -> Array:
    """(n, dof) poses with some parameters spread evenly over their limits, at most half a turn and 0.5 m from q."""
    reach = np.where(body.rotates[columns], np.pi / 2, 0.5)
    low = np.maximum(body.limits[columns, 0], q[columns] - reach)
    high = np.minimum(body.limits[columns, 1], q[columns] + reach)
    poses = np.tile(q, (n, 1))
    poses[:, columns] = low + Halton(len(columns), scramble=False).random(n) * (high - low)
    return poses
