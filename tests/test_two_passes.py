"""Tracking in both directions."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from recordings import TrueStart, cycle_for, joint_errors_mm, small_simulation, with_images
from test_easier_start import RULE, TurnedRoundAtFirst

import tracker.tracking.windows
from tracker.evidence.auto import AutoEvidence
from tracker.foundation.arrays import Image
from tracker.foundation.errors import InitializationError
from tracker.synthesis.simulation.sequence import Simulation
from tracker.tracking.cycle import Cycle
from tracker.tracking.estimate import Status
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.loss import LossRule
from tracker.tracking.sequence import track
from tracker.tracking.trajectory import Replay, Step
from tracker.tracking.two_passes import track_twice
from tracker.tracking.windows import length_of_windows, windows_of


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation("two_elbow_rotation", n_frames=9)


def shortened(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(tracker.tracking.windows, "_LONGEST", 4)
    patch.setattr("tracker.tracking.two_passes.SHORTEST", 4)


@pytest.fixture
def short_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    shortened(monkeypatch)


@pytest.fixture
def limbs_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    """No start looks for limbs elsewhere: they are near enough, and it takes a third of the time."""
    monkeypatch.setattr("tracker.tracking.cycle_turn.in_likeliest_places", lambda _, estimate, *more: estimate)


DOUBTING = LossRule(doubtful_above=0.0, again_after=100)
"""Everything is doubtful."""


def twice(simulation: Simulation, cycle: Cycle, done: dict[int, Replay] | None = None) -> list[Step]:
    return list(track_twice(simulation.frames(), simulation.scene, cycle, done or {}, simulation.frames))


@pytest.fixture(scope="module")
def doubted(simulation: Simulation) -> list[Step]:
    """All steps of a run of which everything is doubtful, in short windows."""
    with pytest.MonkeyPatch.context() as patch:
        shortened(patch)
        return twice(simulation, cycle_for(simulation, TrueStart(simulation), loss=DOUBTING))


def kept(steps: list[Step]) -> dict[int, Replay]:
    """What a journal has of them."""
    return {
        step.frame.index: Replay(step.frame.index, step.frame.time_s, step.estimates, {}, step.overlap, step.untrusted)
        for step in steps
    }


def errors_mm(simulation: Simulation, steps: list[Step]) -> list[float]:
    return [float(joint_errors_mm(simulation, 0, step.frame.index, step.estimates[0].q).mean()) for step in steps]


@pytest.mark.parametrize(("n_frames", "most"), [(1, 4), (4, 4), (5, 4), (9, 4), (9, 100)])
def test_windows_have_every_frame_once_and_see_beyond(simulation: Simulation, n_frames: int, most: int) -> None:
    frames = list(simulation.frames())[:n_frames]
    windows = list(windows_of(iter(frames), most))
    assert [frame.index for window, _ in windows for frame in window] == list(range(n_frames))
    for window, beyond in windows:
        after = window[-1].index + 1
        assert [frame.index for frame in beyond] == list(range(after, min(after + most // 4, n_frames)))


def test_large_images_make_short_windows_or_one_pass(simulation: Simulation, monkeypatch: pytest.MonkeyPatch) -> None:
    first = next(iter(simulation.frames()))
    n_bytes = sum(image.nbytes for image in first.images if image is not None)
    for most, length in ((5 * n_bytes, 4), (1000 * n_bytes, 100), (n_bytes - 1, 0)):
        monkeypatch.setattr(tracker.tracking.windows, "_MOST_BYTES", most)
        assert length_of_windows(first) == length
    steps = twice(simulation, cycle_for(simulation, TrueStart(simulation), loss=DOUBTING))
    assert [step.estimates[0].status for step in steps] == [Status.BOOTSTRAPPED] + 8 * [Status.TRACKED]


def test_without_doubt_the_first_pass_stays_as_it_is(simulation: Simulation) -> None:
    cycle = cycle_for(simulation, TrueStart(simulation))
    once = list(track(simulation.frames(), simulation.scene, cycle, {}, simulation.frames))
    for one, other in zip(once, twice(simulation, cycle), strict=True):
        np.testing.assert_array_equal(one.estimates[0].q, other.estimates[0].q)


def test_both_ways_are_as_exact_as_one(simulation: Simulation, doubted: list[Step]) -> None:
    steps, frames = doubted, list(simulation.frames())
    assert [(step.frame.index, step.frame.time_s) for step in steps] == [(one.index, one.time_s) for one in frames]
    assert {step.estimates[0].status for step in steps} == {Status.TRACKED}
    assert [step.ready for step in steps] == [3, 2, 1, 0, 3, 2, 1, 0, 0]
    assert max(errors_mm(simulation, steps)) < 8  # TRACKED_MM of test_tracking
    assert [step.frame.index for step in steps if step.start is not None] == [0]


@pytest.mark.usefixtures("short_windows")
@pytest.mark.parametrize("doubtful_above", [0.25, 0.0])
def test_a_start_beyond_the_first_window_is_told_in_its_frame(simulation: Simulation, doubtful_above: float) -> None:
    rule = replace(RULE, doubtful_above=doubtful_above, again_after=100)
    cycle = cycle_for(simulation, TurnedRoundAtFirst(simulation, until=2), loss=rule)
    steps = twice(simulation, cycle)
    assert [step.frame.index for step in steps if step.start is not None] == [5]
    assert max(errors_mm(simulation, steps)) < 10


@pytest.mark.usefixtures("limbs_stay")
def test_what_was_wrong_at_first_is_mended_from_behind(simulation: Simulation) -> None:
    rule = LossRule(again_after=3, doubtful_above=0.0, lost_below=0.0, rehearse=0)
    cycle = cycle_for(simulation, TurnedRoundAtFirst(simulation, until=1, at_first=0.9), loss=rule)
    once = list(track(simulation.frames(), simulation.scene, cycle))
    assert min(errors_mm(simulation, once[:2])) > 100
    assert max(errors_mm(simulation, twice(simulation, cycle))) < 10


@pytest.mark.usefixtures("short_windows", "limbs_stay")
def test_a_limb_that_jumps_between_two_windows_is_told(simulation: Simulation, monkeypatch: pytest.MonkeyPatch) -> None:
    """An arm held up from the second window on, in which it keeps its place."""
    forwards, body, first = tracker.tracking.windows._forwards, simulation.scene.persons[0].body, 4

    def held_up(*asked: Any) -> tuple[list[Step], Any]:
        steps, reached = forwards(*asked)
        for n, step in enumerate(steps):
            q = step.estimates[0].q.copy()
            q[body.names.index("left_arm_abduction")] += np.radians(80 * (step.frame.index >= first))
            steps[n] = replace(step, estimates=(replace(step.estimates[0], q=q, doubts=()),))
        return steps, replace(reached, before=steps[-1])

    monkeypatch.setattr(tracker.tracking.windows, "_forwards", held_up)
    steps = twice(simulation, cycle_for(simulation, TrueStart(simulation)))
    told = [step.frame.index for step in steps if "left_arm" in step.estimates[0].ambiguous]
    assert told == [4, 5, 6, 7]


def test_a_limb_that_jumps_is_followed_back_though_no_frame_is_in_doubt(
    simulation: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An arm held up by the first pass until it falls into place: the way back has it right before as well."""
    forwards, body, until = tracker.tracking.windows._forwards, simulation.scene.persons[0].body, 4

    def held_up(*asked: Any) -> tuple[list[Step], Any]:
        steps, reached = forwards(*asked)
        for n, step in enumerate(steps[:until]):
            q = step.estimates[0].q.copy()
            q[body.names.index("left_arm_abduction")] += np.radians(80)
            estimates = (replace(step.estimates[0], q=q, status=Status.TRACKED),)
            steps[n] = replace(step, estimates=estimates, scene=step.scene.with_pose(0, q))
        return steps, reached

    cycle = cycle_for(simulation, TrueStart(simulation))
    monkeypatch.setattr(tracker.tracking.windows, "_forwards", held_up)
    assert max(errors_mm(simulation, twice(simulation, cycle))) < 8
    monkeypatch.setattr(tracker.tracking.windows, "with_jumps", lambda steps, _=None: list(steps))
    # the first frames are followed back without a jump as well
    assert max(errors_mm(simulation, twice(simulation, cycle))) < 8
    monkeypatch.setattr(tracker.tracking.windows, "_FIRST", 1)
    assert max(errors_mm(simulation, twice(simulation, cycle))[:until]) > 30


@pytest.mark.usefixtures("short_windows")
@pytest.mark.parametrize("n_kept", [2, 4, 6, 8])
def test_an_interrupted_run_goes_on_to_the_same_poses(simulation: Simulation, doubted: list[Step], n_kept: int) -> None:
    cycle = cycle_for(simulation, TrueStart(simulation), loss=DOUBTING)
    again = twice(simulation, cycle, kept(doubted[:n_kept]))
    for one, other in zip(doubted, again, strict=True):
        np.testing.assert_array_equal(one.estimates[0].q, other.estimates[0].q)
        np.testing.assert_array_equal(one.estimates[0].covariance, other.estimates[0].covariance)


@pytest.mark.usefixtures("short_windows")
def test_an_extended_run_keeps_what_it_had(simulation: Simulation) -> None:
    cycle = cycle_for(simulation, TrueStart(simulation), loss=DOUBTING)
    short = list(track_twice(itertools.islice(simulation.frames(), 6), simulation.scene, cycle, {}, simulation.frames))
    longer = twice(simulation, cycle, kept(short))
    assert len(longer) == 9
    for one, other in zip(short, longer[:6], strict=True):
        np.testing.assert_array_equal(one.estimates[0].q, other.estimates[0].q)
    assert max(errors_mm(simulation, longer)) < 8


def test_nobody_in_the_first_frames_is_an_error_in_time(simulation: Simulation) -> None:
    cycle = cycle_for(simulation, loss=LossRule(start_within=3))
    dark = with_images(simulation, lambda t, v, image: np.zeros_like(image))
    with pytest.raises(InitializationError):
        list(track_twice(dark, simulation.scene, replace(cycle, plates=(None,) * 4), {}, simulation.frames))


@pytest.mark.usefixtures("short_windows")
def test_whose_limbs_are_all_in_doubt_is_so_for_a_resumed_run(simulation: Simulation) -> None:
    """Images that tell little of any limb: what frames teach, and which windows are tracked back, hangs on it."""
    loss = LossRule(improbable_below=1.0, doubtful_above=10, ambiguous_above=10)
    cycle = cycle_for(simulation, TrueStart(simulation), loss=loss, evidence=AutoEvidence(), plates=(None,) * 4)
    whole = twice(simulation, cycle)
    assert all(len(step.estimates[0].vague) == 4 and not step.estimates[0].limbs_in_doubt for step in whole)
    for one, other in zip(whole, twice(simulation, cycle, kept(whole[:4])), strict=True):
        np.testing.assert_array_equal(one.estimates[0].q, other.estimates[0].q)


@pytest.mark.usefixtures("short_windows", "limbs_stay")
def test_who_was_away_is_found_anew_when_he_is_back_not_when_he_goes(simulation: Simulation) -> None:
    """The way back finds him in the last frame before he goes; time goes on."""
    away = range(3, 6)

    def empty_meanwhile(t: int, v: int, image: Image | None) -> Image | None:
        plate = simulation.plates[v]
        return plate.picture if t in away and plate is not None else image

    frames = list(with_images(simulation, empty_meanwhile))
    # who is not there would be searched for in vain
    refined = TwistIcpEstimation()
    cycle = cycle_for(simulation, TrueStart(simulation), loss=LossRule(again_after=1), estimation=refined)
    steps = list(track_twice(iter(frames), simulation.scene, cycle, {}, lambda: iter(frames)))
    found = [step.estimates[0].status for step in steps]
    assert [n for n, status in enumerate(found) if status is Status.LOST] == list(away)
    assert found[2] is Status.TRACKED
    assert found[6] is Status.RECOVERED
    assert set(found[7:]) == {Status.TRACKED}
