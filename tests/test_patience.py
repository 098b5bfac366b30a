"""A start that cannot succeed: looked for once in a frame, and given up with its reason after a stated time."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import count

import pytest
from recordings import cycle_for, small_simulation

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.errors import GivenUpError, InitializationError
from tracker.foundation.progress import Tally, silent
from tracker.images.plate import Plate
from tracker.images.sight import Sight
from tracker.synthesis.simulation.sequence import Simulation
from tracker.tracking.bootstrapping import bootstrap
from tracker.tracking.found_before import FoundBefore
from tracker.tracking.initialization import Stages
from tracker.tracking.initialization.pca import PcaInitialization
from tracker.tracking.loss import LossRule
from tracker.tracking.recorded_plates import without_persons
from tracker.tracking.sequence import track
from tracker.tracking.start import Start


class InVain:
    """Tells what it does, and finds nobody."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        self.asked.append(frame.index)
        stages.progress("start: pose 1 of 2")
        raise InitializationError(f"frame {frame.index}: a cupboard")


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation(n_frames=6)


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between two looks at the clock ten seconds of processor time pass."""
    clock = count(0.0, 10.0)
    monkeypatch.setattr("tracker.tracking.patience.time.process_time", lambda: next(clock))


@pytest.mark.usefixtures("slow")
def test_a_start_in_vain_is_given_up_with_its_reason_and_the_time(simulation: Simulation) -> None:
    start = InVain()
    steps = track(
        simulation.frames(), simulation.scene, cycle_for(simulation, start, loss=LossRule(start_within_s=70.0))
    )
    with pytest.raises(GivenUpError) as given_up:
        list(steps)
    assert start.asked == [0, 1, 2], "30 s a frame"
    told = str(given_up.value)
    assert "nobody was found in 70 s of processor time, 2 frames searched to the end" in told
    assert "the last reason: frame 1: a cupboard" in told
    assert "loss.start_within_s" in told
    assert not isinstance(given_up.value, InitializationError), "no other foreground, stance or frame is tried"


@pytest.mark.usefixtures("slow")
def test_who_is_found_and_lost_is_looked_for_however_long_that_takes(simulation: Simulation) -> None:
    """Only a first start is given up: later frames are written one way or the other."""
    cycle = cycle_for(simulation, PcaInitialization(hypotheses=1, turn_step_deg=90.0), loss=LossRule(rehearse=0))
    assert len(list(track(simulation.frames(), simulation.scene, cycle))) == 6


def test_who_was_looked_for_in_vain_is_not_looked_for_in_the_same_frame_again(simulation: Simulation) -> None:
    """Whether plates show persons is asked, bodies are fitted, and then poses are tracked: each begins in one frame."""
    start = InVain()
    recorded = tuple(replace(plate, recorded=True) for plate in simulation.plates)
    cycle = without_persons(cycle_for(simulation, start, plates=recorded), simulation.scene, simulation.frames)
    frame = next(simulation.frames())
    for again in (cycle, replace(cycle, before=FoundBefore())):
        step = bootstrap(Sight(frame, again.plates), simulation.scene, again)
        assert step.why_unfound == "frame 0: a cupboard"
    assert start.asked == [0]
    others = tuple(Plate(plate.picture) for plate in simulation.plates)
    bootstrap(Sight(frame, others), simulation.scene, replace(cycle, plates=others))
    assert start.asked == [0, 0], "before other plates he may be found"


def test_a_tally_counts_what_threads_begin() -> None:
    told: list[str] = []
    tally = Tally(told.append, "pose", 2)
    tally.expect(6)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda _: tally.begin(), range(8)))
    tally.begin()
    assert sorted(told[:8]) == [f"pose {n} of 8" for n in range(1, 9)]
    assert told[8] == "pose 9 of 9"
    Tally(silent, "pose").begin()
