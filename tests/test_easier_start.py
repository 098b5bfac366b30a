"""Starts that are uncertain, looked for in later frames and followed back; persons doubted, looked for anew."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from doubted import in_doubt
from recordings import TrueStart, cycle_for, joint_errors_mm, small_simulation, with_images

from tracker.bodies.limbs import turned_round
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Array, Image
from tracker.foundation.errors import InitializationError
from tracker.synthesis.simulation.sequence import Simulation
from tracker.tracking.cycle import Cycle
from tracker.tracking.estimate import Estimate, Status
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.initialization import Stages
from tracker.tracking.loss import LossRule, Troubles, is_out_of_sight, sought_anew
from tracker.tracking.objective import Objective
from tracker.tracking.sequence import track
from tracker.tracking.start import Hypothesis, Start
from tracker.tracking.trajectory import Replay, Step

RULE = LossRule(look_ahead_s=(0.08, 0.2, 0.24), look_on_s=(), rehearse=0)
"""A twentieth of a second is a frame and a bit."""


class TurnedRoundAtFirst:
    """Somebody turned round, unsurely, before a frame; nobody in it; the truth, surely, after it."""

    def __init__(self, simulation: Simulation, until: int, sure: float = 0.95, at_first: float = 0.2) -> None:
        self.simulation, self.until, self.sure, self.at_first = simulation, until, sure, at_first
        self.asked: list[int] = []

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        self.asked.append(frame.index)
        if frame.index == self.until:
            raise InitializationError("nobody there")
        truth = self.simulation.poses[0][frame.index]
        early = frame.index < self.until
        q = turned_round(scene.persons[0].body, truth) if early else truth
        one = Hypothesis(q, 3.0, self.at_first if early else 0.9, 0.1, 0.0)
        return Start((q,), (), ((one,),), (self.at_first if early else self.sure,))


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation("two_elbow_rotation", n_frames=9)


def tracked(simulation: Simulation, cycle: Cycle, done: dict[int, Replay] | None = None) -> list[Step]:
    return list(track(simulation.frames(), simulation.scene, cycle, done or {}, simulation.frames))


def errors_mm(simulation: Simulation, steps: list[Step]) -> list[float]:
    return [float(joint_errors_mm(simulation, 0, step.frame.index, step.estimates[0].q).mean()) for step in steps]


def test_the_first_frames_are_followed_back_from_a_surer_start(simulation: Simulation) -> None:
    start = TurnedRoundAtFirst(simulation, until=2)
    steps = tracked(simulation, cycle_for(simulation, start, loss=RULE))
    assert start.asked == [0, 2, 5]  # the first that is sure enough ends it
    assert max(errors_mm(simulation, steps)) < 10
    statuses = [step.estimates[0].status for step in steps]
    assert statuses == [Status.TRACKED] * 5 + [Status.BOOTSTRAPPED] + [Status.TRACKED] * 3
    assert [step.frame.index for step in steps if step.start is not None] == [5]
    assert [step.frame.time_s for step in steps] == [frame.time_s for frame in simulation.frames()]


def test_nobody_is_looked_for_anew_on_the_way_back(simulation: Simulation) -> None:
    """Who is lost on it waits where he was seen last: another start would lead back to something else."""

    def nobody_between(t: int, v: int, image: Image | None) -> Image | None:
        return simulation.plates[v].picture if t == 4 else image

    start, frames = TurnedRoundAtFirst(simulation, until=2), tuple(with_images(simulation, nobody_between))
    next(track(iter(frames), simulation.scene, cycle_for(simulation, start, loss=RULE), {}, lambda: iter(frames)))
    assert start.asked == [0, 2, 5]


@pytest.mark.parametrize(("at_first", "asked"), [(0.2, [0, 1, 4]), (0.6, [0])])
def test_where_no_start_is_rather_right_than_wrong_it_is_looked_for_further_on(
    simulation: Simulation, at_first: float, asked: list[int]
) -> None:
    start = TurnedRoundAtFirst(simulation, until=2, at_first=at_first)
    rule = replace(RULE, look_ahead_s=(0.04,), look_on_s=(0.16, 0.2))
    steps = tracked(simulation, cycle_for(simulation, start, loss=rule))
    assert start.asked[: len(asked) + 1] == asked, "the first that is rather right ends it"
    assert (max(errors_mm(simulation, steps)) < 10) == (len(asked) == 3)


def test_a_run_that_cannot_look_ahead_starts_where_it_starts(simulation: Simulation) -> None:
    cycle = cycle_for(simulation, TurnedRoundAtFirst(simulation, until=2), loss=RULE)
    step = next(track(simulation.frames(), simulation.scene, cycle))
    assert step.estimates[0].status is Status.BOOTSTRAPPED
    assert joint_errors_mm(simulation, 0, 0, step.estimates[0].q).mean() > 100


@pytest.mark.parametrize("changes", [{"look_ahead_s": ()}, {"look_ahead_s": (100.0,)}])
def test_nothing_is_followed_back_without_need_or_leave(simulation: Simulation, changes: dict[str, object]) -> None:
    start = TurnedRoundAtFirst(simulation, until=2)
    cycle = cycle_for(simulation, start, loss=replace(RULE, again_after=100, **changes))  # type: ignore[arg-type]
    step = next(track(simulation.frames(), simulation.scene, cycle, reopen=simulation.frames))
    assert start.asked == [0]
    assert step.estimates[0].status is Status.BOOTSTRAPPED


def test_a_later_start_that_is_no_surer_changes_nothing(simulation: Simulation) -> None:
    cycle = cycle_for(simulation, TurnedRoundAtFirst(simulation, until=2, sure=0.1), loss=RULE)
    step = next(track(simulation.frames(), simulation.scene, cycle, reopen=simulation.frames))
    assert step.estimates[0].status is Status.BOOTSTRAPPED


def test_an_interrupted_run_is_followed_back_again(simulation: Simulation) -> None:
    cycle = cycle_for(simulation, TurnedRoundAtFirst(simulation, until=2), loss=RULE)
    whole = tracked(simulation, cycle)
    kept = {
        step.frame.index: Replay(step.frame.index, step.frame.time_s, step.estimates, {}, step.overlap)
        for step in whole[:3]
    }
    again = tracked(simulation, cycle, kept)
    for one, other in zip(whole, again, strict=True):
        np.testing.assert_array_equal(one.estimates[0].q, other.estimates[0].q)
        assert one.estimates[0].status is other.estimates[0].status


def looked_for(estimates: Sequence[Estimate], rule: LossRule, found: Estimate | None = None) -> list[int]:
    """The frames in which a person is looked for anew, and what is found in them, if anything is."""
    troubles, frames = Troubles(), list[int]()
    for n, one in enumerate(estimates):
        sought = sought_anew(one, troubles, rule)
        frames += [n] if sought else []
        troubles = troubles.after(found if sought and found is not None else one, rule)
    return frames


def test_the_doubted_are_looked_for_ever_more_rarely(simulation: Simulation) -> None:
    cycle = cycle_for(simulation, TurnedRoundAtFirst(simulation, until=0))
    step = next(track(itertools.islice(simulation.frames(), 1, None), simulation.scene, cycle))
    doubtful, rule = in_doubt(step.estimates[0], whole=True), LossRule(again_after=5)
    fine = in_doubt(step.estimates[0])
    assert looked_for([doubtful] * 100, rule) == [4, 9, 34]
    assert looked_for([fine] * 100, rule) == []
    lost = replace(fine, status=Status.LOST)
    assert sought_anew(fine, Troubles.of_lost(1, lost, rule), rule), "seen again after a loss"


def test_who_is_lost_is_searched_for_at_once_and_then_where_he_is_looked_for_anew(simulation: Simulation) -> None:
    cycle = cycle_for(simulation, TurnedRoundAtFirst(simulation, until=0))
    step = next(track(itertools.islice(simulation.frames(), 1, None), simulation.scene, cycle))
    lost, rule = replace(step.estimates[0], status=Status.LOST), LossRule(restart_every=3)
    due = looked_for([lost] * 60, rule)
    assert due == [0, 3, 9, 21, 45]
    in_sight = [n for n in range(60) if not is_out_of_sight(Troubles.of_lost(n, lost, rule), rule)]
    assert in_sight == [0, 1, 2, *due[1:]]


def test_who_is_lost_again_and_again_is_looked_for_as_rarely_as_who_stays_lost(simulation: Simulation) -> None:
    """Unless he was there without doubt in between."""
    cycle = cycle_for(simulation, TurnedRoundAtFirst(simulation, until=0))
    step = next(track(itertools.islice(simulation.frames(), 1, None), simulation.scene, cycle))
    fine, rule = in_doubt(step.estimates[0]), LossRule(restart_every=3, again_after=100)
    lost, doubtful = replace(fine, status=Status.LOST), in_doubt(fine, whole=True)
    anew = replace(doubtful, status=Status.RECOVERED)
    assert looked_for([lost, fine] * 4, rule) == list(range(8))
    assert looked_for([lost, lost, doubtful] * 8, rule) == [0, 2, 9, 21]
    assert looked_for([lost] * 30, rule, anew) == looked_for([lost] * 30, rule), "lost at once when found"
    assert looked_for([lost] * 5, rule, fine) == list(range(5))


def test_who_has_left_is_not_searched_for_in_every_frame(
    simulation: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is asked of an estimation, whatever it does then."""
    asked = list[bool]()

    monkeypatch.setattr("tracker.tracking.cycle_turn.in_likeliest_places", lambda _, estimate, *more: estimate)

    class Watched(TwistIcpEstimation):
        def estimate(self, objective: Objective, starts: Array) -> Estimate:
            asked.append(objective.nearby)
            return super().estimate(objective, starts)

    def shown(t: int, v: int, image: Image | None) -> Image | None:
        return simulation.plates[v].picture.copy() if t >= 1 else image

    rule = LossRule(rehearse=0, look_ahead_s=(), restart_every=1)
    cycle = cycle_for(simulation, TrueStart(simulation), loss=rule, estimation=Watched())
    steps = list(track(with_images(simulation, shown), simulation.scene, cycle))
    assert [step.estimates[0].lost for step in steps] == [False] + [True] * 8
    assert (
        sum(asked)
        == sum(is_out_of_sight(Troubles.of_lost(n, steps[1].estimates[0], rule), rule) for n in range(8))
        == 4
    )


def test_who_is_doubted_is_found_anew_where_the_images_speak_for_it(simulation: Simulation) -> None:
    start = TurnedRoundAtFirst(simulation, until=1)
    rule = LossRule(again_after=3, doubtful_above=0.0, lost_below=0.0, rehearse=0)
    steps = list(track(simulation.frames(), simulation.scene, cycle_for(simulation, start, loss=rule)))
    statuses = [step.estimates[0].status for step in steps]
    assert statuses[:4] == [Status.BOOTSTRAPPED, Status.TRACKED, Status.RECOVERED, Status.TRACKED]
    assert start.asked[:2] == [0, 2]
    found = errors_mm(simulation, steps)
    assert found[1] > 100
    assert max(found[2:]) < 10
