"""Refinement always, search only on doubt: the default estimation."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pydantic

from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.tracking.budget import Tries
from tracker.tracking.estimate import Estimate
from tracker.tracking.estimation import Estimation
from tracker.tracking.estimation.best_first import BestFirstEstimation
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.objective import Objective
from tracker.tracking.proposals import elsewhere, exchanged, tried
from tracker.tracking.verdict import likelier


@component
class HybridEstimation:
    """Refines the candidate predictions; limbs with unexplained contour are searched and refined again.

    Refinement alone is safe to about 3 degrees and 2 cm and ten times cheaper than the search, which covers the
    paper's range of 15 degrees and 10 cm.
    """

    first: Estimation = BestFirstEstimation()
    """The search of the whole pose."""

    then: Estimation = TwistIcpEstimation()
    """The refinement."""

    refined: int = pydantic.Field(default=2, ge=1)
    """Number of candidate predictions that are refined, the best ones first; the others only if a group stays poor."""

    search: bool = False
    """Search the whole pose in every frame, as the paper does; otherwise only if the refined prediction is poor."""

    search_below: float = pydantic.Field(default=0.85, ge=0, le=1)
    """Explained share of a limb's visible contour below which the limb is searched. A shin 30 degrees off still lies 80
    % on edges: of its other side, of the other leg, of the floor. With 0.9, and trunks searched like limbs, six runs of
    hard movement were as exact (30 mm, 19 instead of 16 frames with a joint 150 mm off) for 1.4 to 7 times the
    time: docs/lab/limits_and_vain_searches.md."""

    trunk_above: float = pydantic.Field(default=0.35, ge=0, le=1)
    """Left-over share above which a group other than a limb is searched: trunk and head, of which clothes and hair
    leave over up to 0.3 in right frames."""

    # See docs/lab/vain_searches.md.
    worse: float = pydantic.Field(default=0.06, ge=0, le=1)
    """The same after a search in vain, until the next one is due: excess over the share that it left over.
    A model that does not quite fit leaves something unexplained in every frame."""

    again_after: int = pydantic.Field(default=4, ge=1)
    """Frames after which a group that stays poor is searched again; after the second search in vain twice as many, and
    four times as many from then on. In every frame, a person whom no model fits would cost seconds a frame, in vain."""

    min_visible_px: float = pydantic.Field(default=100.0, ge=0)
    """Groups that show less contour than this over all views are judged as if they showed this much, px."""

    most_limbs: int = pydantic.Field(default=2, ge=0)
    """If more groups than this are poor, the whole pose is searched first."""

    rounds: int = pydantic.Field(default=2, ge=1)
    """Number of rounds in which limbs are exchanged and searched, while one stays unexplained."""

    def estimate(self, objective: Objective, starts: Array) -> Estimate:
        """The best of the refined predictions and, if needed, of the refined search results."""
        order = np.argsort(objective(starts), kind="stable")
        first = order[: self.refined]
        refined = self.then.estimate(objective, starts[first])
        weak = self._worth_searching(objective, refined)
        if len(starts) > len(first) and (weak or self.search):
            refined = likelier(objective, refined, self.then.estimate(objective, starts[order[len(first) :]]))
            weak = self._worth_searching(objective, refined)
        if objective.nearby or not (weak or self.search):
            return refined
        begin = time.perf_counter()
        if self.search or len(weak) > self.most_limbs:
            searched = self.first.estimate(objective.by_parts(), np.concatenate([starts, refined.q[None]]))
            again = self.then.estimate(objective, searched.q[None])
            again = replace(again, evaluations=again.evaluations + searched.evaluations)
            refined = likelier(objective, refined, again)
        refined = self._limbs_searched(objective, refined)
        left_over = self._left_over(objective.body, refined)
        vain = {group: left_over[group] for group in weak if left_over[group] > self._allowed(objective.body, group)}
        return replace(refined, search_s=time.perf_counter() - begin, vain=vain)

    def _limbs_searched(self, objective: Objective, estimate: Estimate) -> Estimate:
        """The estimate with weak limbs in their likeliest places, exchanged or elsewhere."""
        weak = self._worth_searching(objective, estimate)
        for _ in range(self.rounds):
            before = estimate
            for propose in (exchanged.propose, elsewhere.propose):
                for limb in _limbs_of(objective.body, weak):
                    estimate = tried(objective, estimate, limb, propose, self.then)
                weak = self._worth_searching(objective, estimate)
            if not weak or estimate.q is before.q:
                break
        return estimate

    def _worth_searching(self, objective: Objective, estimate: Estimate) -> tuple[str, ...]:
        """Fine groups that leave over too much, unless a recent search for them was in vain."""
        body, tries = objective.body, {} if objective.history is None else objective.history.tries
        weak = []
        for group, share in self._left_over(body, estimate).items():
            so_far = tries.get(group, Tries())
            resting = not so_far.due(self.again_after, most=4 * self.again_after) and share <= so_far.share + self.worse
            if share > self._allowed(body, group) and not resting:
                weak.append(group)
        return tuple(weak)

    def _allowed(self, body: BodyModel, group: str) -> float:
        """Largest left-over share of a group that is not poor."""
        return 1 - self.search_below if group in body.limbs else self.trunk_above

    def _left_over(self, body: BodyModel, estimate: Estimate) -> dict[str, float]:
        """Fine group -> left-over length of model and scene there, over its contour."""
        left_over_px, visible_px = estimate.account.left_over_px, estimate.account.visible_px
        of_groups = {group: body.parts_of(group) for group in body.fine_groups}
        return {
            group: float(left_over_px[parts].sum() / max(float(visible_px[parts].sum()), self.min_visible_px))
            for group, parts in of_groups.items()
        }


def _limbs_of(body: BodyModel, groups: tuple[str, ...]) -> list[str]:
    """Those of some groups that hang on the trunk: limbs, head and tail."""
    return [group for group in groups if group in body.limbs or group in body.doubted_ends]
