"""Who may face the other way is begun turned round; who was rather wrongly found, and never confirmed, is doubtful."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from doubted import in_doubt
from recordings import TrueStart, cycle_for, joint_errors_mm, small_simulation
from test_easier_start import RULE, TurnedRoundAtFirst

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.evidence.auto import AutoEvidence
from tracker.results.recording._journal_line import line_of, replay_of
from tracker.synthesis.simulation.sequence import Simulation
from tracker.tracking import windows
from tracker.tracking.cycle import Cycle
from tracker.tracking.doubt import Because
from tracker.tracking.estimate import Status
from tracker.tracking.initialization import Stages
from tracker.tracking.loss import LossRule
from tracker.tracking.sequence import track
from tracker.tracking.start import RATHER_RIGHT, Start
from tracker.tracking.trajectory import Replay, Step
from tracker.tracking.two_passes import track_twice
from tracker.tracking.way_round import may_face_the_other_way, n_sure, the_better_way_round

DOUBTING = replace(RULE, doubtful_above=0.0, again_after=100, look_ahead_s=(), look_on_s=())
"""Everything is doubtful."""

UNASKED = LossRule(rehearse=0, look_ahead_s=(), look_on_s=())
"""No start is rehearsed, or looked for later."""


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation("two_elbow_rotation", n_frames=9)


def twice(simulation: Simulation, cycle: Cycle, done: Mapping[int, Replay] | None = None) -> list[Step]:
    return list(track_twice(simulation.frames(), simulation.scene, cycle, done or {}, simulation.frames))


def errors_mm(simulation: Simulation, steps: list[Step]) -> list[float]:
    return [float(joint_errors_mm(simulation, 0, step.frame.index, step.estimates[0].q).mean()) for step in steps]


def facing(simulation: Simulation, turned: bool, sure: float = 0.1) -> TurnedRoundAtFirst | TrueStart:
    return TurnedRoundAtFirst(simulation, until=100, at_first=sure) if turned else Unsure(simulation)


class Unsure(TrueStart):
    """Starts right, and not for sure."""

    sure = 0.1

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        return replace(super().start(frame, scene, stages), sureness=(self.sure,))


class Sure(Unsure):
    """Starts right and for sure."""

    sure = 0.9


@pytest.fixture(scope="module")
def rightly(simulation: Simulation) -> list[Step]:
    """All steps of a run that is begun right."""
    return list(track(simulation.frames(), simulation.scene, cycle_for(simulation, Unsure(simulation))))


@pytest.fixture(scope="module")
def wrongly(simulation: Simulation) -> list[Step]:
    """Of one that is begun turned round."""
    cycle = cycle_for(simulation, facing(simulation, turned=True))
    return list(track(simulation.frames(), simulation.scene, cycle))


@pytest.fixture(scope="module")
def doubted(simulation: Simulation) -> list[Step]:
    """Of one that is begun so, and doubtful in every frame."""
    cycle = cycle_for(simulation, facing(simulation, turned=True), loss=DOUBTING)
    return list(track(simulation.frames(), simulation.scene, cycle))


@pytest.mark.parametrize(
    ("turned", "sure", "doubtful_above", "tried", "right"),
    [
        (True, 0.1, 0.0, True, True),
        (True, 0.9, 0.0, False, False),
        (True, 0.1, 100.0, False, False),
        (False, 0.1, 0.0, True, True),
    ],
)
def test_who_is_doubtful_throughout_and_was_not_found_for_sure_is_begun_the_other_way_round(
    simulation: Simulation, turned: bool, sure: float, doubtful_above: float, tried: bool, right: bool
) -> None:
    """And so kept if that leaves less."""
    said: list[str] = []
    rule = replace(DOUBTING, doubtful_above=doubtful_above)
    start = facing(simulation, turned, sure)
    cycle = cycle_for(simulation, start, loss=rule, progress=lambda line, *_: said.append(line))
    steps = twice(simulation, cycle)
    assert any("facing the other way" in line for line in said) == tried
    errors = errors_mm(simulation, steps)
    assert max(errors) < 10 if right else min(errors) > 50
    assert [step.frame.index for step in steps if step.start is not None] == [0]


@pytest.mark.parametrize("n_known", [1, 9])
def test_what_is_known_of_the_first_frame_alone_does_not_keep_who_faces_the_other_way(
    simulation: Simulation, doubted: list[Step], n_known: int
) -> None:
    """Plates of the recording's own are made for a start that is kept; a way through all frames has asked before."""
    cycle = cycle_for(simulation, facing(simulation, turned=True), loss=DOUBTING)
    assert min(errors_mm(simulation, doubted)) > 50
    known = {step.frame.index: step.estimates for step in doubted[:n_known]}
    steps = twice(simulation, cycle.knowing(known, doubted[0].start, believed=True))
    assert (max(errors_mm(simulation, steps)) < 10) == (n_known == 1)


def test_doubts_of_limbs_count_as_those_of_the_whole(simulation: Simulation, rightly: list[Step]) -> None:
    """Of R-UpperBody, turned round, 43 of 100 frames were doubtful, and in all of them legs were ambiguous."""
    steps, cycle = rightly, cycle_for(simulation)
    assert may_face_the_other_way(with_legs_in_doubt(steps, 4), cycle) == []
    assert may_face_the_other_way(with_legs_in_doubt(steps, 5), cycle) == [0]
    assert may_face_the_other_way(with_legs_in_doubt(steps[1:], 5), cycle) == [], "nobody was found in these"


@pytest.mark.parametrize(("n_sure_then", "kept"), [(4, False), (3, True)])
def test_frames_without_doubt_decide_before_what_is_left(
    simulation: Simulation, rightly: list[Step], wrongly: list[Step], n_sure_then: int, kept: bool
) -> None:
    """Begun the other way he leaves more; that counts where both ways leave about as few frames without doubt."""
    cycle = cycle_for(simulation, facing(simulation, turned=True))
    right, wrong = (sum(one.estimates[0].distance_px for one in steps) for steps in (rightly, wrongly))
    assert wrong > right
    steps, others = with_legs_in_doubt(rightly, 9), with_legs_in_doubt(wrongly, 9 - n_sure_then)
    assert n_sure(others, 0) == n_sure_then
    better, reached, _ = the_better_way_round(steps, "as it was", cycle, [0], lambda _: (others, "turned"))
    assert (better is steps, reached == "as it was") == (kept, kept)


def with_legs_in_doubt(steps: list[Step], n_frames: int) -> list[Step]:
    """The steps, in the first so many of which the left leg is ambiguous, and nothing is in doubt elsewhere."""
    told = []
    for n, step in enumerate(steps):
        limbs = ("left_leg",) if n < n_frames else ()
        told.append(replace(step, estimates=(in_doubt(step.estimates[0], *limbs),)))
    return told


def doubt(monkeypatch: pytest.MonkeyPatch, at_first: bool, n_frames: int) -> None:
    """Windows of four frames; a leg is in doubt in the first so many, and in the very first perhaps the whole."""

    def with_doubts(steps: list[Step], _: Step | None = None) -> list[Step]:
        told = []
        for step in steps:
            index = step.frame.index
            limbs = ("left_leg",) if index < n_frames else ()
            one = in_doubt(step.estimates[0], *limbs, whole=at_first and index == 0)
            told.append(replace(step, estimates=(one,)))
        return told

    monkeypatch.setattr(windows, "_LONGEST", 4)
    monkeypatch.setattr("tracker.tracking.two_passes.SHORTEST", 4)
    monkeypatch.setattr(windows, "with_jumps", with_doubts)


@pytest.mark.parametrize(
    ("start", "doubtful_at_first", "n_in_doubt", "n_doubtful"),
    [(Unsure, True, 9, 9), (Unsure, True, 8, 8), (Unsure, True, 3, 1), (Unsure, False, 9, 0), (Sure, True, 9, 9)],
)
def test_who_was_rather_wrongly_found_and_is_never_without_doubt_is_doubtful(
    simulation: Simulation,
    monkeypatch: pytest.MonkeyPatch,
    start: type[Unsure],
    doubtful_at_first: bool,
    n_in_doubt: int,
    n_doubtful: int,
) -> None:
    """Window by window; however sure the start was, it is rather wrong if its frame turns out doubtful."""

    doubt(monkeypatch, doubtful_at_first, n_in_doubt)
    steps = twice(simulation, cycle_for(simulation, start(simulation), loss=UNASKED))
    assert (steps[0].start_confidence[0] < RATHER_RIGHT) == doubtful_at_first
    assert [step.estimates[0].verdict is Status.DOUBTFUL for step in steps] == [n < n_doubtful for n in range(9)]
    assert [step.estimates[0].ambiguous != () for step in steps] == [n < n_in_doubt for n in range(9)]
    unsure = [Because.UNSURE_START in {one.because for one in step.estimates[0].doubts} for step in steps]
    assert unsure == [n < n_doubtful > 1 for n in range(9)]


def test_a_run_resumed_behind_who_is_unconfirmed_goes_on_to_the_same_poses(
    simulation: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both have learnt colours from nobody whom nothing has confirmed."""
    doubt(monkeypatch, at_first=True, n_frames=9)
    cycle = cycle_for(simulation, Unsure(simulation), loss=UNASKED, evidence=AutoEvidence())
    whole = twice(simulation, cycle)
    kept = {step.frame.index: replay_of(line_of(step).encode()) for step in whole[:4]}
    for one, other in zip(whole, twice(simulation, cycle, kept), strict=True):
        np.testing.assert_array_equal(one.estimates[0].q, other.estimates[0].q)
        assert one.estimates[0].doubtful
        assert other.estimates[0].doubtful
