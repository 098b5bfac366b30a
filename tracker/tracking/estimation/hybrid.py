"""Refinement always, search where it is needed: the default estimation."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Literal

import numpy as np
import pydantic

from tracker.bodies.limbs import are_apart, exchanged, mirrored, scattered_evenly
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.configuration.components import component
from tracker.tracking.estimate import Estimate
from tracker.tracking.estimation import Estimation
from tracker.tracking.estimation.best_first import BestFirstEstimation
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.objective import Objective


@component
class HybridEstimation:
    """Refines the candidate predictions; limbs whose contour stays unexplained are searched and refined again.

    Refinement alone is safe to about 3 degrees and 2 cm and ten times cheaper than the search, which covers the
    paper's range of 15 degrees and 10 cm.
    """

    first: Estimation = BestFirstEstimation()
    """The search of the whole pose."""

    limb: BestFirstEstimation = BestFirstEstimation(range_deg=60.0, step_deg=10.0, patience=6)
    """The search of a single limb."""

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
    like limbs, six runs of R-Turn, T-Punch-light, V-Dance and K-Kick were as exact (30 mm, 19 instead of 16 frames
    with a joint 150 mm off) for 1.4 to 7 times the time."""

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

    scatter: int = pydantic.Field(default=192, ge=1)
    """Poses of a limb scattered over its joint limits when it is searched."""

    restarts: int = pydantic.Field(default=2, ge=0)
    """How many of them the search starts from, besides the pose at hand."""

    limbs: Literal["in_turn", "compared"] = "in_turn"
    """Whether each limb is searched from what was found of the one before, or all from the same pose and the best find
    is taken first. With departures the first limb would take what the images show of the second (R-UpperBody: the
    right arm followed the left one for nine frames)."""

    rounds: int = pydantic.Field(default=2, ge=1)
    """How often limbs are exchanged and searched, as long as one stays unexplained."""

    worth_px: float = pydantic.Field(default=0.05, ge=0)
    """What a round must have brought for another one to follow, px. Images say 0.2 px or more of a limb; on V-Dance,
    R-Turn, K-Kick and T-Punch-light no round after a smaller gain gained more than 0.023 px."""

    promising_px: float = pydantic.Field(default=1.0, ge=0)
    """How much farther off a pose may be for each search or refinement of a limb that is still to come, px; others are
    given up. Of 150 exchanges on those recordings none was of use that began more than 0.8 px farther off, of 131
    searches no start that did by more than 1.1 px."""

    def estimate(self, objective: Objective, starts: Array) -> Estimate:
        """The best of the refined predictions and, where needed, of the refined search results."""
        order = np.argsort(objective(starts), kind="stable")
        first = order[: self.refined]
        refined = self.then.estimate(objective, starts[first])
        weak = self._weak_groups(objective, refined)
        if len(starts) > len(first) and (weak or self.search):
            refined = _better(refined, self.then.estimate(objective, starts[order[len(first) :]]))
            weak = self._weak_groups(objective, refined)
        if objective.nearby or not (weak or self.search):
            return refined
        begin = time.perf_counter()
        if self.search or len(weak) > self.most_limbs:
            searched = self.first.estimate(objective.by_parts(), np.concatenate([starts, refined.q[None]]))
            again = self.then.estimate(objective, searched.q[None])
            again = replace(again, evaluations=again.evaluations + searched.evaluations)
            refined = _better(refined, again)
            weak = self._weak_groups(objective, refined)
        for _ in range(self.rounds):
            before = refined.distance_px
            for change in (self._exchanged, self._searched_limbs, self._searched_together):
                if weak:
                    refined = _likelier(objective, refined, change(objective, refined, weak))
                    weak = self._weak_groups(objective, refined)
            if not weak or before - refined.distance_px < self.worth_px:
                break
        return replace(refined, search_s=time.perf_counter() - begin)

    def _exchanged(self, objective: Objective, estimate: Estimate, groups: tuple[str, ...]) -> Estimate:
        """One of the groups and its partner on the other side have changed places; of several pairs the best."""
        body, q = objective.body, estimate.q
        pairs = sorted({tuple(sorted((group, other))) for group in groups if (other := body.partner_of(group))})
        if not pairs:
            return estimate
        poses = np.array([place(body, q, *pair) for pair in pairs for place in (mirrored, exchanged)])
        poses = self._promising(objective, poses, q, 2)
        return self.then.estimate(objective, poses) if len(poses) else estimate

    def _searched_limbs(self, objective: Objective, estimate: Estimate, groups: tuple[str, ...]) -> Estimate:
        """Each limb in turn searched, from what was found of the one before or all from the same pose."""
        estimate = replace(estimate, evaluations=0)  # those before are counted already
        if self.limbs == "compared":
            return self._compared_limbs(objective, estimate, groups)
        for group in groups:
            estimate = _better(estimate, self._searched(objective, estimate, group))
        return estimate

    def _compared_limbs(self, objective: Objective, estimate: Estimate, groups: tuple[str, ...]) -> Estimate:
        """Each limb searched from the same pose; the best find is taken, and of the others what fits beside it."""
        body, found = objective.body, [(group, self._searched(objective, estimate, group)) for group in groups]
        best = estimate
        for group, one in sorted(found, key=lambda pair: pair[1].distance_px):
            if best is estimate:
                best = one if one.distance_px < best.distance_px else best
                continue
            pose, columns = best.q.copy(), body.group(group)
            pose[columns] = one.q[columns]
            if float(objective(pose[None])[0]) < best.distance_px:
                best = _better(best, self.then.estimate(objective, pose[None]))
        return replace(best, evaluations=sum(one.evaluations for _, one in found))

    def _searched(self, objective: Objective, estimate: Estimate, group: str) -> Estimate:
        """A limb searched from where it is and from the best of poses scattered over its joint limits."""
        q, columns = estimate.q, objective.body.group(group)
        rough = objective.by_parts()
        scattered = scattered_evenly(objective.body, q, columns, self.scatter)
        best = self._promising(rough, scattered, q, 2)[: self.restarts]
        poses, n_searched = self.limb.search_from(rough, np.array([q, *best]), columns)
        refined = self.then.estimate(objective, poses[np.argsort(objective(poses), kind="stable")[:2]])
        return replace(refined, evaluations=refined.evaluations + self.scatter + n_searched)

    def _searched_together(self, objective: Objective, estimate: Estimate, groups: tuple[str, ...]) -> Estimate:
        """Several limbs, one after the other, from poses of all of them.

        Legs that are taken for each other stay so as long as one of them is held.
        """
        if len(groups) < 2:
            return estimate
        body, q, rough = objective.body, estimate.q, objective.by_parts()
        columns = np.concatenate([body.group(group) for group in groups])
        neutral = q.copy()
        neutral[columns] = body.rest()[columns]
        scattered = np.concatenate([neutral[None], scattered_evenly(body, q, columns, self.scatter)])
        best = scattered[np.argsort(rough(scattered), kind="stable")[: self.restarts]]
        found, n_evaluations = np.array([neutral, *best]), len(scattered)
        for n_left, group in zip(range(len(groups), 0, -1), groups, strict=True):
            found = self._promising(rough, found, q, n_left + 1)
            if len(found):
                found, n = self.limb.search_from(rough, found, body.group(group))
                n_evaluations += n
        found = self._promising(rough, found, q, 1)
        if not len(found):
            return replace(estimate, evaluations=n_evaluations)
        refined = self.then.estimate(objective, found)
        return replace(refined, evaluations=refined.evaluations + n_evaluations)

    def _promising(self, objective: Objective, poses: Array, q: Array, n_steps: int) -> Array:
        """Those of some poses (B, dof) that so many searches or refinements of limbs may bring below that of q (dof,).

        The nearest ones come first.
        """
        distances, most_px = objective(poses), float(objective(q[None])[0]) + n_steps * self.promising_px
        order = np.argsort(distances, kind="stable")
        found: Array = poses[order[distances[order] <= most_px]]
        return found

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


def _better(one: Estimate, other: Estimate) -> Estimate:
    """The estimate of less distance, with the evaluations of both."""
    if other is one:
        return one
    best = other if other.distance_px < one.distance_px else one
    return replace(best, evaluations=one.evaluations + other.evaluations)


def _likelier(objective: Objective, one: Estimate, other: Estimate) -> Estimate:
    """The estimate that contours speak for, and where limbs are in other places the colours of parts as well."""
    if other is one or not are_apart(objective.body, other.q, one.q):
        return _better(one, other)
    costs = objective.deciding_px(np.array([one.q, other.q]))
    best = other if costs[1] < costs[0] else one
    return replace(best, evaluations=one.evaluations + other.evaluations)
