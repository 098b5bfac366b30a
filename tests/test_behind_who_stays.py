"""Backdrops of somebody who stays in one place: what they know, whom they are for, and runs with them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import pytest
from recordings import TrueStart, cycle_for, small_simulation
from test_backdrops import legs, showing
from test_run import killed_after

import tracker.tracking.recorded_plates as recorded_plates
from tracker.acquisition.calibrated_views import ViewSettings
from tracker.evidence.auto import AutoEvidence
from tracker.images.plate import Plate
from tracker.images.sight import Sight
from tracker.results.recording._journal_line import line_of, replay_of
from tracker.running.jobs import execute, load_job
from tracker.running.jobs.track import TrackJob
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Recipe, Simulation, write_sequence
from tracker.tracking.bootstrapping import first_start
from tracker.tracking.cycle import Cycle, State
from tracker.tracking.easier_start import LedBack
from tracker.tracking.loss import LossRule
from tracker.tracking.recorded_plates import behind_who_stays
from tracker.tracking.sequence import Looking, tracked
from tracker.tracking.start import Start
from tracker.tracking.trajectory import Step
from tracker.tracking.windows import there

pytestmark = pytest.mark.usefixtures("limbs_stay")


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation("arm_swing", n_frames=2)


def staying(simulation: Simulation, **changes: object) -> Cycle:
    """A cycle without plates, for a recording whose backdrops show the legs of somebody who stands in one place."""
    plates = showing(simulation, legs, unknown=False)
    start = TrueStart(simulation, off_deg=0.0, off_m=0.0)
    cycle = cycle_for(simulation, start, plates=(None,) * 4, evidence=AutoEvidence())
    return replace(cycle, backdrops=lambda: plates, **changes)  # type: ignore[arg-type]


def test_backdrops_know_what_the_first_frame_shows_where_nobody_is(simulation: Simulation) -> None:
    cycle, box = staying(simulation), (slice(20, 60), slice(20, 50))
    backdrops = cycle.backdrops()
    assert backdrops[0] is not None
    # something that stands there for most of the recording, but not now
    gone = backdrops[0].picture.copy()
    gone[box] = (gone[box] + np.uint8(128)) % 255
    backdrops = (Plate(gone), *backdrops[1:])
    found = behind_who_stays(replace(cycle, backdrops=lambda: backdrops), simulation.scene, simulation.frames)
    first = simulation.scene.with_poses(tuple(poses[0] for poses in simulation.poses))
    for v, model in enumerate(CpuSynthesis().silhouettes(first)):
        plate, shown = found.plates[v], backdrops[v]
        assert plate is not None
        assert shown is not None
        assert plate.unknown is not None
        assert plate.stays
        np.testing.assert_array_equal(plate.picture, shown.picture)
        # the pose is refined, by a pixel at most
        assert plate.unknown[cv2.erode(model.astype(np.uint8), np.ones((3, 3))) > 0].all()
        beyond = cv2.dilate(model.astype(np.uint8), np.ones((31, 31))) == 0
        if v == 0:
            assert plate.unknown[box].all()
            beyond[10:70, 10:60] = False
        # the shadow on the floor differs as well
        beyond[np.flatnonzero(model.any(axis=1))[-1] - 30 :] = False
        assert not plate.unknown[beyond].any()


def test_who_stays_is_found_once_and_never_before_plates_that_are_unknown_behind_them(simulation: Simulation) -> None:
    cycle = staying(simulation)
    found = behind_who_stays(cycle, simulation.scene, simulation.frames)
    assert found.stages.plates == (None,) * 4
    first = next(iter(simulation.frames()))
    begun, _ = tracked(Sight(first), simulation.scene, cycle, State.before(simulation.scene), Looking(False, None))
    start = first_start(first, simulation.scene, found)
    np.testing.assert_array_equal(start.poses[0], begun.estimates[0].q)
    (known,) = found.before.estimates.values()
    np.testing.assert_array_equal(known[0].q, begun.estimates[0].q)


def test_who_was_followed_back_from_a_later_frame_starts_in_the_first_one(
    simulation: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    cycle = staying(simulation)
    steps, _ = there(list(simulation.frames()), simulation.scene, cycle)
    first, last = (replay_of(line_of(step).encode()) for step in steps)
    sure = Start((steps[1].estimates[0].q,), sureness=(0.9,))
    led = LedBack(1, sure, {1: last, 0: first})

    def led_back(*_: object) -> tuple[Step, LedBack]:
        return steps[0], led

    monkeypatch.setattr(recorded_plates, "tracked", led_back)
    found = behind_who_stays(cycle, simulation.scene, simulation.frames)
    start = found.before.start
    assert start is not None
    assert (found.before.frame, start.sureness, list(found.before.estimates)) == (0, (0.9,), [0, 1])
    np.testing.assert_array_equal(start.poses[0], first.estimates[0].q)


@pytest.fixture(scope="module")
def unplated(tmp_path_factory: pytest.TempPathFactory) -> TrackJob:
    """Somebody who swings the arms where they stand; nothing is told of the background."""
    folder = tmp_path_factory.mktemp("run") / "sequence"
    config = write_sequence(Recipe("arm_swing", seconds=0.4, size=(320, 256)), folder)
    lines = config.read_text(encoding="utf-8").splitlines()
    config.write_text("\n".join(line for line in lines if not line.startswith("background")), encoding="utf-8")
    start = ["initialization.use=auto", "initialization.poses=truth_poses.csv"]
    less = [
        "passes=1",
        "inspection=false",
        "reading.downscale=1",
        "persons.0.carries=[]",
        "estimation.use=twist_icp",
        "loss.rehearse=0",
        "loss.look_ahead_s=[]",
        "recordings=[{use='csv_table'},{use='journal'},{use='run_json'}]",
    ]
    job = load_job("track", config, [*start, *less])
    assert isinstance(job, TrackJob)
    return job


@pytest.mark.parametrize("shape", ["model", "recording"])
def test_a_run_says_what_it_knows_of_who_stays_and_resumes_with_the_same(
    unplated: TrackJob, tmp_path: Path, shape: Literal["model", "recording"], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Resumed with a body that is fitted already, it makes the same of the backdrops as before the fit."""
    once = ViewSettings(rounds=1)
    monkeypatch.setattr("tracker.running.jobs._persons.ViewSettings", lambda: once)
    said: list[str] = []
    unplated = replace(unplated, persons=tuple(replace(one, shape=shape) for one in unplated.persons))
    whole = execute(unplated, tmp_path / "whole", progress=lambda what, *_: said.append(what))
    assert any(line.startswith("person1: lengths and shapes fitted to") for line in said) == (shape == "recording")
    words = "contours, foreground where nobody stays, colours and motion of the parts, 4 of 4 views"
    assert any(line.startswith(f"evidence: {words}") for line in said)
    assert json.loads((whole.folder / "run.json").read_text(encoding="utf-8"))["choices"]["evidence"].startswith(words)

    resumed = execute(unplated, killed_after(6, whole.folder, tmp_path / "part"), resume=True)
    for name in ("poses.csv", "joints.csv"):
        assert (resumed.folder / name).read_bytes() == (whole.folder / name).read_bytes()


def test_plates_are_left_alone_where_they_tell_nothing_or_nobody_was_surely_found(simulation: Simulation) -> None:
    cycle = staying(simulation)
    one_view = replace(cycle, backdrops=lambda: (cycle.backdrops()[0], None, None, None))
    assert behind_who_stays(one_view, simulation.scene, simulation.frames) is one_view
    in_doubt = behind_who_stays(replace(cycle, loss=LossRule(doubtful_above=0.0)), simulation.scene, simulation.frames)
    assert in_doubt.plates == cycle.plates
    assert in_doubt.before.start_in(0) is not None, "the same would be looked for again"


def test_who_stands_out_from_the_backdrops_may_be_in_doubt(simulation: Simulation) -> None:
    """Edges of clutter doubt what stands out plainly; without these plates an arm was off in 44 of 61 frames."""
    cycle = replace(staying(simulation), loss=LossRule(doubtful_above=0.0))
    empty = simulation.plates
    found = behind_who_stays(replace(cycle, backdrops=lambda: empty), simulation.scene, simulation.frames)
    assert all(plate is not None and plate.stays for plate in found.plates)
    # nobody is in them, so nothing of them is unknown
    unknown = [0.0 if plate is None or plate.unknown is None else float(plate.unknown.mean()) for plate in found.plates]
    assert max(unknown) < 0.01
