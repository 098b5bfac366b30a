"""Who was rather wrongly found, and never confirmed, is doubtful."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from doubted import in_doubt
from recordings import TrueStart, cycle_for, small_simulation

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
from tracker.tracking.start import RATHER_RIGHT, Start
from tracker.tracking.trajectory import Replay, Step
from tracker.tracking.two_passes import track_twice

UNASKED = LossRule(rehearse=0, look_ahead_s=(), look_on_s=())
"""No start is rehearsed, or looked for later."""


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation("two_elbow_rotation", n_frames=9)


def twice(simulation: Simulation, cycle: Cycle, done: Mapping[int, Replay] | None = None) -> list[Step]:
    return list(track_twice(simulation.frames(), simulation.scene, cycle, done or {}, simulation.frames))


class Unsure(TrueStart):
    """Starts right, and not for sure."""

    sure = 0.1

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        return replace(super().start(frame, scene, stages), sureness=(self.sure,))


class Sure(Unsure):
    """Starts right and for sure."""

    sure = 0.9


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
