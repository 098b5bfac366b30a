"""Limbs that jump where the images hardly say where they are: bridged from before to after.

What is hidden, or points at the camera that sees it, has its place from what little the images say of it; from one
frame to the next that may be elsewhere. A limb that moves evenly instead is believed, unless images speak against it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tracker.arrays import Array, Mask
from tracker.body import BodyModel
from tracker.clock import Clock
from tracker.contours import joined
from tracker.cycle import Cycle, State
from tracker.cycle_turn import objective_of
from tracker.estimate import Estimate, Status
from tracker.limbs import apart_m
from tracker.loss import judged
from tracker.objective import Objective
from tracker.outcome import finished
from tracker.sight import Sight
from tracker.strangers import hide_strangers
from tracker.trajectory import Step

_SPANS = 2, 3, 4, 5, 6, 8, 10, 12, 16
"""Frames from the last pose that stays to the next one: limbs are wrong for that long between two searches."""

_PX_PER_M2 = 250.0
"""What roughness costs, px of distance in one frame for a square metre of squared second differences of places, the
limb's joints averaged: what jumps by 15 cm from one frame to the next, which is 0.045, must be worth 11 px."""

_LEAST_PX = 3.0
"""What a bridge must gain at least, px."""

_SMOOTHER = 4.0
"""How much less rough it must be, a factor: a fist that strikes is rough, and so is each even piece of its way (1.6 in
T-Punch-light, whose arms were right and were moved by 8 cm); an arm that jumps behind the trunk and back is not (9)."""

_MOST_PX = 0.1
"""What a bridge may cost the images in one frame, px. In 27 s of martial arts 16 of 17 ways that were right, of fists
that strike out and back, would have cost 0.25 to 1.4 px in some frame; wrong ones of T-Punch-light, of a hidden hand of
R-UpperBody and of one frame of the martial arts 0.05, 0.03 and nothing. At 0.5 px arms that were right were led up to
0.3 m astray: 21 of 680 frames had a joint off there, and two have at 0.1."""


@dataclass(frozen=True)
class _Bridge:
    """A limb on its way from one frame to another, as if it moved evenly."""

    person: int
    group: str
    first: int
    """Number of the first step that is bridged."""

    poses: Array
    """(n, dof) one a step."""

    away_m: Array
    """(n,) how far a joint of the limb is from where it was found, at most."""

    smoother_px: float
    """What its smoothness may cost, px."""

    @property
    def steps(self) -> range:
        """Numbers of the steps."""
        return range(self.first, self.first + len(self.poses))


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
    bridges = [bridge for k in range(len(steps[0].estimates)) for bridge in _candidates(steps, k)]
    if not bridges:
        return steps
    asked = _asked(steps, cycle, begin, before, bridges)
    chosen = _best(bridges, steps, asked)
    return _with(steps, cycle, chosen, asked) if chosen else steps


def _candidates(steps: Sequence[Step], k: int) -> list[_Bridge]:
    """Ways of the limbs of person k that are smoother than those found."""
    body = steps[0].scene.persons[k].body
    way = _Way(
        k,
        body,
        np.array([step.frame.time_s for step in steps]),
        np.array([step.estimates[k].q for step in steps]),
        np.array([step.estimates[k].status is Status.TRACKED for step in steps]),
        apart_m(body),
    )
    groups = [group for group in body.fine_groups if body.partner_of(group)]
    ends = [(a, a + span) for span in _SPANS for a in range(1, len(steps) - span - 1)]
    tried = (way.bridged(group, a, b) for group in groups for a, b in ends)
    return [bridge for bridge in tried if bridge is not None]


@dataclass(frozen=True)
class _Way:
    """How a person has moved, as found."""

    person: int
    body: BodyModel
    times_s: Array
    """(T,)"""

    poses: Array
    """(T, dof)"""

    tracked: Mask
    """(T,) whether a pose came from the one before."""

    least_m: float
    """What a joint must have been elsewhere by, metres."""

    @cached_property
    def places(self) -> Array:
        """(T, L, 3) landmarks."""
        found: Array = self.body.landmarks_in_world(self.poses)
        return found

    def bridged(self, group: str, a: int, b: int) -> _Bridge | None:
        """A limb led evenly from step a to step b; None where it was not elsewhere meanwhile, or moved as limbs do."""
        marks, columns = self.body.landmarks_of(group), self.body.group(group)
        # a step more at each end: what is even in between may begin or end with a jerk
        found = self.places[a - 1 : b + 2, marks]
        rough = _rough(found)
        if not self.tracked[a : b + 1].all() or _PX_PER_M2 * rough < _LEAST_PX:
            return None
        even = self.poses[a + 1 : b].copy()
        shares = ((self.times_s[a + 1 : b] - self.times_s[a]) / (self.times_s[b] - self.times_s[a]))[:, None]
        even[:, columns] = (1 - shares) * self.poses[a, columns] + shares * self.poses[b, columns]
        moved = found.copy()
        moved[2:-2] = self.body.landmarks_in_world(even)[:, marks]
        away_m = np.linalg.norm(moved - found, axis=2).max(axis=1)[2:-2]
        smooth = _rough(moved)
        smoother_px = _PX_PER_M2 * (rough - smooth)
        if away_m.max() <= self.least_m or smoother_px <= _LEAST_PX or rough <= _SMOOTHER * smooth:
            return None
        return _Bridge(self.person, group, a + 1, even, away_m, smoother_px)


def _rough(places: Array) -> float:
    """Squared second differences of places (T, L, 3), summed over time, averaged over landmarks, m^2."""
    return float((np.diff(places, 2, axis=0) ** 2).sum(axis=(0, 2)).mean())


def _asked(
    steps: Sequence[Step], cycle: Cycle, begin: State, before: Step | None, bridges: Sequence[_Bridge]
) -> dict[int, _Asked]:
    """Step's number -> what its poses are judged by, for the steps of some bridges."""
    farthest = _farthest(bridges)
    asked, state = {}, begin
    for n, step in enumerate(steps[: max(farthest) + 1]):
        sight = Sight(step.frame, cycle.plates, None if before is None else before.model_px)
        if n in farthest:
            hide_strangers(sight, step.scene, cycle.synthesis)
            poses = {k: np.array([step.estimates[k].q, *own]) for k, own in farthest[n].items()}
            around = joined([cycle.synthesis.contours(step.scene, k, own) for k, own in poses.items()])
            observed = cycle.evidence.observe(sight, around, state.memory)
            objectives = {k: objective_of(step.scene, k, cycle, observed, state.histories[k]) for k in poses}
            asked[n] = _Asked(sight, objectives)
        state, before = state.after(sight, step, cycle.evidence), step
    return asked


def _farthest(bridges: Sequence[_Bridge]) -> dict[int, dict[int, list[Array]]]:
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


def _best(bridges: Sequence[_Bridge], steps: Sequence[Step], asked: Mapping[int, _Asked]) -> list[_Bridge]:
    """The bridges that gain most, none of a limb over another one.

    None gains more than its smoothness is worth: of thousands few are asked about.
    """
    chosen: list[_Bridge] = []
    left = sorted(bridges, key=lambda bridge: -bridge.smoother_px)
    gains: dict[int, float] = {}
    while left:
        best, most = None, _LEAST_PX
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


def _gain(bridge: _Bridge, steps: Sequence[Step], asked: Mapping[int, _Asked]) -> float:
    """What a bridge gains, px; 0 of one that is not worth while."""
    cost = 0.0
    for n, q in zip(bridge.steps, bridge.poses, strict=True):
        found, even = asked[n].objectives[bridge.person](np.array([steps[n].estimates[bridge.person].q, q]))
        # images that like the even way better are no reason: a search would have found it
        cost += max(even - found, 0.0)
        if even - found > _MOST_PX or bridge.smoother_px - cost <= _LEAST_PX:
            return 0.0
    return bridge.smoother_px - cost


def _overlap(one: _Bridge, other: _Bridge) -> bool:
    """Whether two bridges are of one limb, and one ends where the other one has moved it."""
    same = (one.person, one.group) == (other.person, other.group)
    return same and one.steps.start <= other.steps.stop and other.steps.start <= one.steps.stop


def _with(steps: Sequence[Step], cycle: Cycle, chosen: Sequence[_Bridge], asked: Mapping[int, _Asked]) -> list[Step]:
    """The steps with limbs where some bridges have them."""
    by_step: dict[int, list[_Bridge]] = defaultdict(list)
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
        observed = next(iter(asked[n].objectives.values())).asked.observed
        done = finished(
            asked[n].sight,
            scene,
            cycle.synthesis,
            tuple(estimates),
            observed,
            Clock(step.seconds),
            cycle.loss.least_views,
        )
        changed[n] = replace(done, frame=step.frame, start=step.start)
    return changed


def _moved(objective: Objective, cycle: Cycle, estimate: Estimate, bridges: Iterable[_Bridge], n: int) -> Estimate:
    """An estimate with some limbs moved: what was found is as likely, which its covariance says."""
    body: BodyModel = objective.body
    q, elsewhere = estimate.q.copy(), []
    for bridge in bridges:
        columns = body.group(bridge.group)
        q[columns] = bridge.poses[n - bridge.first, columns]
        if bridge.away_m[n - bridge.first] > apart_m(body):
            elsewhere.append(bridge.group)
    half = (q - estimate.q) / 2
    found = objective.estimate(q, estimate.covariance + np.outer(half, half), estimate.evaluations)
    found = judged(body, replace(found, search_s=estimate.search_s), cycle.loss, estimate.status)
    return found.doubting(elsewhere)
