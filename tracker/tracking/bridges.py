"""Limbs that jump where the images hardly say where they are: bridged from before to after.

What is hidden, or points at the camera that sees it, has its place from what little the images say of it; from one
frame to the next that may be elsewhere. A limb that moves evenly instead is believed, unless images speak against it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tracker.arrays import Array
from tracker.body import BodyModel
from tracker.clock import Clock
from tracker.contours import joined
from tracker.doubt import Because, Doubt
from tracker.estimate import Estimate
from tracker.limbs import apart_m
from tracker.objective import Objective
from tracker.sight import Sight
from tracker.strangers import hide_strangers
from tracker.tracking.cycle import Cycle, State
from tracker.tracking.cycle_turn import judged_by, objective_of
from tracker.tracking.even_ways import LEAST_PX, Bridge, candidates
from tracker.tracking.outcome import finished
from tracker.trajectory import Step

# See docs/lab/bridges.md.
_MOST_PX = 0.1
"""What a bridge may cost the images in one frame, px. In 27 s of martial arts 16 of 17 ways that were right, of fists
that strike out and back, would have cost 0.25 to 1.4 px in some frame; wrong ones of T-Punch-light, of a hidden hand of
R-UpperBody and of one frame of the martial arts 0.05, 0.03 and nothing. At 0.5 px arms that were right were led up to
0.3 m astray: 21 of 680 frames had a joint off there, and two have at 0.1."""


@dataclass(frozen=True)
class _Asked:
    """What a frame's poses are judged by, one objective a person."""

    sight: Sight
    objectives: Mapping[int, Objective]


def bridged(steps: list[Step], cycle: Cycle, begin: State, before: Step | None) -> list[Step]:
    """The steps, rough limbs moved evenly where the images hardly mind.

    Args:
        steps: frames that follow one another, tracked.
        cycle: the components.
        begin: the state before the first of them.
        before: the step before, if there is one.

    Returns:
        The same steps if there is nothing to bridge; else those changed have greater sigmas, and a limb is ambiguous
        where it was found somewhere else.
    """
    bridges = [bridge for k in range(len(steps[0].estimates)) for bridge in candidates(steps, k)]
    if not bridges:
        return steps
    asked = _asked(steps, cycle, begin, before, bridges)
    chosen = _best(bridges, steps, asked)
    return _with(steps, cycle, chosen, asked) if chosen else steps


def _asked(
    steps: Sequence[Step], cycle: Cycle, begin: State, before: Step | None, bridges: Sequence[Bridge]
) -> dict[int, _Asked]:
    """Step's number -> what its poses are judged by, for the steps of some bridges."""
    farthest = _farthest(bridges)
    asked, state = {}, begin
    for n, step in enumerate(steps[: max(farthest) + 1]):
        sight = Sight(step.frame, cycle.plates, None if before is None else before.model_px)
        if n in farthest:
            if not state.anybody_lost:  # as when the frame was tracked
                hide_strangers(sight, step.scene, cycle.synthesis)
            poses = {k: np.array([step.estimates[k].q, *own]) for k, own in farthest[n].items()}
            around = joined([cycle.synthesis.contours(step.scene, k, own) for k, own in poses.items()])
            observed = cycle.evidence.observe(sight, around, state.memory)
            objectives = {k: objective_of(step.scene, k, cycle, observed, state.histories[k]) for k in poses}
            asked[n] = _Asked(sight, objectives)
        state, before = state.after(sight, step, cycle.evidence), step
    return asked


def _farthest(bridges: Sequence[Bridge]) -> dict[int, dict[int, list[Array]]]:
    """Step's number -> person -> for each limb the pose of all bridges in which it is farthest from where it was."""
    most: dict[tuple[int, int, str], tuple[float, Array]] = {}
    for bridge in bridges:
        for n, q, away_m in zip(bridge.steps, bridge.poses, bridge.away_m, strict=True):
            limb = n, bridge.person, bridge.group
            if limb not in most or most[limb][0] < away_m:
                most[limb] = float(away_m), q
    found: dict[int, dict[int, list[Array]]] = defaultdict(lambda: defaultdict(list))
    for (n, k, _), (_, q) in most.items():
        found[n][k].append(q)
    return found


def _best(bridges: Sequence[Bridge], steps: Sequence[Step], asked: Mapping[int, _Asked]) -> list[Bridge]:
    """The bridges that gain most, none of a limb over another one.

    None gains more than its smoothness is worth: of thousands few are asked about.
    """
    chosen: list[Bridge] = []
    left = sorted(bridges, key=lambda bridge: -bridge.smoother_px)
    gains: dict[int, float] = {}
    while left:
        best, most = None, LEAST_PX
        for bridge in left:
            if bridge.smoother_px <= most:
                break
            gain = gains.get(id(bridge))
            if gain is None:
                gain = gains[id(bridge)] = _gain(bridge, steps, asked)
            if gain > most:
                best, most = bridge, gain
        if best is None:
            break
        chosen.append(best)
        left = [bridge for bridge in left if not _overlap(best, bridge)]
    return chosen


def _gain(bridge: Bridge, steps: Sequence[Step], asked: Mapping[int, _Asked]) -> float:
    """What a bridge gains, px; 0 of one that is not worth while."""
    cost = 0.0
    for n, q in zip(bridge.steps, bridge.poses, strict=True):
        found, even = asked[n].objectives[bridge.person](np.array([steps[n].estimates[bridge.person].q, q]))
        # images that like the even way better are no reason: a search would have found it
        cost += max(even - found, 0.0)
        if even - found > _MOST_PX or bridge.smoother_px - cost <= LEAST_PX:
            return 0.0
    return bridge.smoother_px - cost


def _overlap(one: Bridge, other: Bridge) -> bool:
    """Whether two bridges are of one limb, and one ends where the other one has moved it."""
    same = (one.person, one.group) == (other.person, other.group)
    return same and one.steps.start <= other.steps.stop and other.steps.start <= one.steps.stop


def _with(steps: Sequence[Step], cycle: Cycle, chosen: Sequence[Bridge], asked: Mapping[int, _Asked]) -> list[Step]:
    """The steps with limbs where some bridges have them."""
    by_step: dict[int, list[Bridge]] = defaultdict(list)
    for bridge in chosen:
        for n in bridge.steps:
            by_step[n].append(bridge)
    changed = list(steps)
    for n, own in by_step.items():
        step, estimates = steps[n], list(steps[n].estimates)
        for k in {bridge.person for bridge in own}:
            moves = [bridge for bridge in own if bridge.person == k]
            estimates[k] = _moved(asked[n].objectives[k], cycle, estimates[k], moves, n)
        scene = step.scene.with_poses(tuple(estimate.q for estimate in estimates))
        clock, least = Clock(step.seconds), cycle.loss.least_views
        done = finished(asked[n].sight, scene, cycle.synthesis, tuple(estimates), clock, least)
        changed[n] = replace(done, frame=step.frame, start=step.start)
    return changed


def _moved(objective: Objective, cycle: Cycle, estimate: Estimate, bridges: Iterable[Bridge], n: int) -> Estimate:
    """An estimate with some limbs moved: what was found is as likely, which its covariance says."""
    body: BodyModel = objective.body
    q, elsewhere = estimate.q.copy(), []
    for bridge in bridges:
        columns = body.group(bridge.group)
        q[columns] = bridge.poses[n - bridge.first, columns]
        if (away_m := float(bridge.away_m[n - bridge.first])) > apart_m(body):
            elsewhere.append(Doubt(bridge.group, Because.BRIDGED, away_m, apart_m(body)))
    half = (q - estimate.q) / 2
    found = objective.estimate(q, estimate.covariance + np.outer(half, half), estimate.evaluations)
    found = judged_by(objective, replace(found, search_s=estimate.search_s), cycle.loss, estimate.status)
    return found.doubting(elsewhere)
