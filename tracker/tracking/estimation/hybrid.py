"""Refinement always, search where it is needed: the default estimation."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pydantic

from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.configuration.components import component
from tracker.tracking.estimate import Estimate
from tracker.tracking.estimation import Estimation
from tracker.tracking.estimation.best_first import BestFirstEstimation
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.objective import Objective
from tracker.tracking.proposals import elsewhere, exchanged, tried
from tracker.tracking.verdict import likelier


@component
class HybridEstimation:
    """Refines the candidate predictions; limbs whose contour stays unexplained are searched and refined again.

    Refinement alone is safe to about 3 degrees and 2 cm and ten times cheaper than the search, which covers the
    paper's range of 15 degrees and 10 cm.
    """

    first: Estimation = BestFirstEstimation()
    """The search of the whole pose."""

    then: Estimation = TwistIcpEstimation()
    """The refinement."""

    refined: int = pydantic.Field(default=2, ge=1)
    """How many of the candidate predictions are refined, the best ones first; the others only where a group stays
    poor."""

    search: bool = False
    """Search the whole pose in every frame, as the paper does; else only where the refined prediction is poor."""

    search_below: float = pydantic.Field(default=0.85, ge=0, le=1)
    """Share of a limb's visible contour that images explain under which the limb is searched. A shin 30 degrees off
    still lies 80 % on edges: those of its other side, of the other leg, of the floor. With 0.9, and trunks searched
    like limbs, six runs of hard movement were as exact (30 mm, 19 instead of 16 frames with a joint 150 mm off) for
    1.4 to 7 times the time: docs/lab/limits_and_vain_searches.md."""

    trunk_above: float = pydantic.Field(default=0.35, ge=0, le=1)
    """Share left over above which a group that is no limb is searched: trunk and head, of which clothes and hair leave
    over up to 0.3 in frames where nothing is wrong."""

    unusual: float = pydantic.Field(default=0.06, ge=0, le=1)
    """The same, by how much the share must be less than is usual for the group: a model that does not quite fit leaves
    something unexplained in every frame."""

    most_usual: float = pydantic.Field(default=0.35, ge=0, le=1)
    """Share above which a limb is poor however usual that is: one in the wrong place leaves over more (see
    `loss.ambiguous_above`)."""

    poor_every: int = pydantic.Field(default=3, ge=1)
    """Frames after which a limb whose usual state is that poor is searched again. In every frame, a person whom no
    model fits costs seconds a frame, to no avail."""

    again_every: int = pydantic.Field(default=10, ge=1)
    """Frames after which a group is searched even if its poor state is usual."""

    min_visible_px: float = pydantic.Field(default=100.0, ge=0)
    """Groups that show less contour than this over all views are judged as if they showed so much, px."""

    most_limbs: int = pydantic.Field(default=2, ge=0)
    """Where more groups than this are poor, the whole pose is searched first."""

    rounds: int = pydantic.Field(default=2, ge=1)
    """How often limbs are exchanged and searched, as long as one stays unexplained."""

    def estimate(self, objective: Objective, starts: Array) -> Estimate:
        """The best of the refined predictions and, where needed, of the refined search results."""
        order = np.argsort(objective(starts), kind="stable")
        first = order[: self.refined]
        refined = self.then.estimate(objective, starts[first])
        weak = self._weak_groups(objective, refined)
        if len(starts) > len(first) and (weak or self.search):
            refined = likelier(objective, refined, self.then.estimate(objective, starts[order[len(first) :]]))
            weak = self._weak_groups(objective, refined)
        if objective.nearby or not (weak or self.search):
            return refined
        begin = time.perf_counter()
        if self.search or len(weak) > self.most_limbs:
            searched = self.first.estimate(objective.by_parts(), np.concatenate([starts, refined.q[None]]))
            again = self.then.estimate(objective, searched.q[None])
            again = replace(again, evaluations=again.evaluations + searched.evaluations)
            refined = likelier(objective, refined, again)
            weak = self._weak_groups(objective, refined)
        for _ in range(self.rounds):
            before = refined
            for propose in (exchanged.propose, elsewhere.propose):
                for limb in _limbs_of(objective.body, weak):
                    refined = tried(objective, refined, limb, propose, self.then)
                weak = self._weak_groups(objective, refined)
            if not weak or refined.q is before.q:
                break
        return replace(refined, search_s=time.perf_counter() - begin)

    def _weak_groups(self, objective: Objective, estimate: Estimate) -> tuple[str, ...]:
        """Fine groups whose contours the scene explains too little, or that leave too much of the scene unexplained."""
        body, history = objective.body, objective.history
        usual_px = None if history is None else history.usual_px
        if history is not None and history.n_frames % self.again_every == 0:
            usual_px = None
        weak, left_over_px = [], estimate.account.left_over_px
        for group in body.fine_groups:
            parts = body.parts_of(group)
            allowed = 1 - self.search_below if group in body.limbs else self.trunk_above
            if usual_px is not None:
                usual = self._share(usual_px[0], usual_px[1], parts)
                poor = usual > self.most_usual and history is not None and history.n_frames % self.poor_every == 0
                allowed = max(allowed, self.unusual + (self.most_usual if poor else usual))
            if self._share(estimate.account.visible_px, left_over_px, parts) > allowed:
                weak.append(group)
        return tuple(weak)

    def _share(self, visible_px: Array, left_over_px: Array, parts: Mask) -> float:
        """How much is left over of some parts' contour, over the contour."""
        return float(left_over_px[parts].sum() / max(float(visible_px[parts].sum()), self.min_visible_px))


def _limbs_of(body: BodyModel, groups: tuple[str, ...]) -> list[str]:
    """Those of some groups that hang on the trunk: limbs, head and tail."""
    return [group for group in groups if group in body.limbs or group in body.doubted_ends]
