"""Runs on disk: results, interruption, resumption."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tracker.bodies.body.description import load_body
from tracker.cameras.rig_layouts import load_rig
from tracker.foundation.errors import ConfigError, SequenceError, TrackerError
from tracker.foundation.progress import Progress
from tracker.results.recording import Recording
from tracker.results.recording.csv_table import CsvTable
from tracker.results.recording.journal import Journal
from tracker.results.recording.overlay import Overlay
from tracker.results.recording.run_json import RunJson
from tracker.running.jobs import described, execute, job_from, load_job
from tracker.running.jobs._record import TrackOutcome
from tracker.running.jobs.track import TrackJob
from tracker.synthesis.simulation.sequence import Recipe, write_sequence
from tracker.tracking.initialization.given import GivenInitialization
from tracker.tracking.loss import LossRule

RESULTS = [
    "poses.csv",
    "sigmas.csv",
    "joints.csv",
    "doubts.csv",
    "limbs.csv",
    "run.json",
    "steps.jsonl",
    "overlay.mp4",
    "parameters.png",
    "report.html",
    "log.txt",
    "config.toml",
    "inputs.json",
    "models",
    "rig.toml",
]


def interrupt_after(n_frames: int) -> Progress:
    """Presses Ctrl-C after some frames."""

    def progress(what: str, done: int = 0, total: int = 0, detail: str = "") -> None:
        if what == "tracking" and done == n_frames:
            raise KeyboardInterrupt

    return progress


@pytest.fixture(scope="module", autouse=True)
def _limbs_stay() -> Iterator[None]:
    """A start, a given one as well, looks for limbs elsewhere: a fifth of the time of a run of six frames."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tracker.tracking.cycle_turn.in_likeliest_places", lambda _, estimate, *more: estimate)
        yield


def killed_after(n_frames: int, whole: Path, folder: Path) -> Path:
    """What a kill leaves of a run: the journal so far, and no table."""
    shutil.copytree(whole, folder)
    lines = (folder / "steps.jsonl").read_bytes().splitlines(keepends=True)
    assert len(lines) > n_frames
    (folder / "steps.jsonl").write_bytes(b"".join(lines[:n_frames]))
    for name in ("poses.csv", "joints.csv", "doubts.csv", "limbs.csv", "run.json"):
        (folder / name).unlink()
    return folder


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> TrackJob:
    """Six frames of a simulated recording, started from its own truth."""
    folder = tmp_path_factory.mktemp("run") / "sequence"
    config = write_sequence(Recipe("arm_swing", seconds=0.24, size=(360, 288)), folder)
    return load_job("track", config, ["initialization.use=given", "initialization.poses=truth_poses.csv"])


KEPT = (CsvTable, Journal, RunJson, Overlay)
"""What a run that is resumed adds to; report and plots are drawn at its end, which takes longer than the tracking."""


@pytest.fixture(scope="module")
def plain(run: TrackJob) -> TrackJob:
    """The same without report and plots."""
    return replace(run, recordings=tuple(one for one in run.recordings if isinstance(one, KEPT)))


@pytest.fixture(scope="module")
def whole(run: TrackJob, tmp_path_factory: pytest.TempPathFactory) -> TrackOutcome:
    """All of it, at once."""
    return execute(run, tmp_path_factory.mktemp("whole") / "out")


def part_of(job: TrackJob, start: int, stop: int, recordings: tuple[Recording, ...]) -> TrackJob:
    return replace(job, reading=replace(job.reading, start=start, stop=stop), recordings=recordings)


def poses(folder: Path) -> list[dict[str, str]]:
    with (folder / "poses.csv").open() as file:
        return list(csv.DictReader(file))


def test_a_run_leaves_all_its_results(run, whole):
    result = whole
    assert sorted(path.name for path in result.folder.iterdir()) == sorted(RESULTS)
    assert (result.n_frames, result.doubts.lost, result.interrupted) == (6, (), False)
    assert {path.name for path in result.files} == set(RESULTS) - {
        "log.txt",
        "config.toml",
        "inputs.json",
        "rig.toml",
        "models",
    }
    assert result.files[0].name == "poses.csv"
    saved = json.loads((result.folder / "run.json").read_text())
    assert saved["complete"]
    assert set(saved["inputs"]) >= {str(run.persons[0].model)}
    assert job_from("track", saved["config"], "run.json", Path("/"), "") == run


def test_a_run_takes_the_time_before_its_first_frame_as_well(plain, tmp_path, monkeypatch):
    """Starts and fits, which may take most of it."""
    told, fitted = dict[str, float](), TrackJob.fitted

    def slowly(job, opened, cycle):
        told["fitting"] = time.perf_counter()
        time.sleep(0.5)
        return fitted(job, opened, cycle)

    monkeypatch.setattr(TrackJob, "fitted", slowly)
    job = part_of(replace(plain, passes=1), 0, 2, plain.recordings)
    outcome = execute(job, tmp_path / "out", progress=lambda what, *_: told.update({what: time.perf_counter()}))
    assert outcome.seconds > told["writing the results"] - told["fitting"]


def test_an_interrupted_run_resumes_to_the_same_result(plain, whole, tmp_path):
    part = execute(plain, tmp_path / "part", progress=interrupt_after(3))
    assert part.interrupted
    assert part.n_frames == 3
    assert len(poses(part.folder)) == 3
    assert not json.loads((part.folder / "run.json").read_text())["complete"]
    with (part.folder / "steps.jsonl").open("a") as file:
        file.write('{"frame": 3, "time_s": 0.1')  # torn by a kill
    resumed = execute(plain, tmp_path / "part", resume=True)
    assert resumed.n_frames == 6
    assert poses(resumed.folder) == poses(whole.folder)
    assert (resumed.folder / "joints.csv").read_bytes() == (whole.folder / "joints.csv").read_bytes()


def test_results_are_not_overwritten(run, tmp_path):
    (tmp_path / "something").write_text("")
    with pytest.raises(ConfigError, match="not empty"):
        execute(run, tmp_path)
    with pytest.raises(SequenceError, match="no run to resume"):
        execute(run, tmp_path / "nowhere", resume=True)


def test_dated_folders_have_a_link_to_the_latest(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = execute(part_of(run, 0, 1, ()))
    assert (tmp_path / "results" / run.name / "latest").resolve() == result.folder.resolve()


def test_a_range_of_frames_keeps_the_numbers_of_the_recording(run, tmp_path):
    result = execute(part_of(run, 2, 5, run.recordings[:1]), tmp_path / "out")
    assert [row["frame"] for row in poses(result.folder)] == ["2", "3", "4"]


def test_the_best_first_search_of_the_paper_runs_alone(run, tmp_path):
    """Lattice steps of 5 degrees and 5 cm leave about half a step in each joint."""
    folder = run.persons[0].model.parent
    table = described(run)
    table["estimation"] = {"use": "best_first"}
    table["evidence"] = {"use": "contours", "similarity": {"use": "chamfer", "outliers": "reject"}}
    paper = job_from("track", table, "paper", folder, "paper")
    result = execute(part_of(paper, 0, 2, run.recordings[:1]), tmp_path / "out")
    assert result.doubts.lost == ()


def test_a_result_is_self_contained_and_its_configuration_runs_again(run, tmp_path, monkeypatch):
    """The models and the cameras load again to the same bits, and so does what was asked for, from anywhere."""
    asked = part_of(run, 0, 2, run.recordings[:1])
    first = execute(asked, tmp_path / "out").folder
    model, body = load_body(first / "models" / "person1.toml"), run.persons[0].body()
    q = body.clamped(np.random.default_rng(0).normal(0, 0.3, body.dof))
    np.testing.assert_array_equal(model.landmarks_in_world(q), body.landmarks_in_world(q))
    np.testing.assert_array_equal(model.shapes, body.shapes)
    rig = load_rig(first / "rig.toml")
    for camera, other in zip(rig.cameras, asked.open().sequence.rig.cameras, strict=True):
        np.testing.assert_allclose(camera.camera_from_world, other.camera_from_world, atol=1e-12)
    monkeypatch.chdir(tmp_path)
    again = load_job("track", Path("out/config.toml"))
    assert again == asked
    second = execute(again, tmp_path / "again").folder
    assert (second / "poses.csv").read_bytes() == (first / "poses.csv").read_bytes()


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file() and path.name != "log.txt"}


def exact(folder: Path) -> dict[str, bytes]:
    """What does not depend on the clock."""
    names = ("poses.csv", "sigmas.csv", "joints.csv", "doubts.csv", "limbs.csv", "overlay.mp4")
    tables = {name: (folder / name).read_bytes() for name in names}
    lines = [json.loads(line) for line in (folder / "steps.jsonl").read_text().splitlines()]
    timeless = [[{**one, "search_s": 0} for one in line["estimates"]] for line in lines]
    return tables | {"steps.jsonl": json.dumps([timeless, [line["frame"] for line in lines]]).encode()}


REFUSED = {
    "another setting": (lambda job: replace(job, loss=LossRule(start_within=9)), r"loss\.start_within = \d+, but 9"),
    "an earlier end": (lambda job: part_of(job, 0, 3, job.recordings), "reading.stop = 4, but 3.*only extend a run"),
    "another begin": (lambda job: part_of(job, 1, 4, job.recordings), "reading.start = 0, but 1 is asked for"),
}


@pytest.fixture(scope="module")
def interrupted(plain, tmp_path_factory):
    """A run over the first four frames, interrupted after two."""
    folder = tmp_path_factory.mktemp("interrupted") / "out"
    asked = part_of(plain, 0, 4, plain.recordings)
    execute(asked, folder, progress=interrupt_after(2))
    return asked, folder


@pytest.mark.parametrize("change", REFUSED)
def test_a_run_is_not_resumed_with_another_configuration(change, interrupted):
    asked, folder = interrupted
    other, words = REFUSED[change]
    before = contents(folder)
    with pytest.raises(ConfigError, match=words):
        execute(other(asked), folder, resume=True)
    assert contents(folder) == before


@pytest.mark.parametrize("fault", ["changed", "gone"])
@pytest.mark.parametrize("name", [".mp4", "rig.toml", "truth_poses.csv"])
def test_a_run_is_not_resumed_with_other_inputs(name, fault, run, interrupted, tmp_path):
    """The recording, the cameras and the start poses, at the path where the others were."""
    folder = tmp_path / "out"
    shutil.copytree(interrupted[1], folder)
    told = json.loads((folder / "inputs.json").read_text())
    path = next(path for path in told if path.endswith(name))
    told[path] = told[path][:-1] + ("0" if told[path][-1] != "0" else "1")
    if fault == "gone":
        told[path + ".old"] = told.pop(path)
    (folder / "inputs.json").write_text(json.dumps(told))
    before = contents(folder)
    with pytest.raises(ConfigError, match=f"{name}.* is (another file than when the run began|no longer there)"):
        execute(interrupted[0], folder, resume=True)
    assert contents(folder) == before


def test_a_resumed_run_may_be_extended(plain, interrupted, tmp_path):
    """To the same bytes as a run that went so far at once."""
    folder = tmp_path / "out"
    shutil.copytree(interrupted[1], folder)
    longer = part_of(plain, 0, 5, plain.recordings)
    whole = execute(longer, tmp_path / "whole").folder
    resumed = execute(longer, folder, resume=True)
    assert (resumed.n_frames, resumed.interrupted) == (5, False)
    assert exact(folder) == exact(whole)
    assert load_job("track", folder / "config.toml").reading.stop == 5
    with pytest.raises(ConfigError, match="only extend"):
        execute(interrupted[0], folder, resume=True)


def test_interrupted_while_it_catches_up_a_run_leaves_what_was_there(run, interrupted, tmp_path):
    folder = tmp_path / "out"
    shutil.copytree(interrupted[1], folder)
    before = contents(folder)
    execute(interrupted[0], folder, resume=True, progress=interrupt_after(1))
    assert contents(folder) == before


def test_a_journal_that_ends_in_something_else_is_cut_there_and_that_is_said(run, interrupted, tmp_path):
    folder, said = tmp_path / "out", []
    shutil.copytree(interrupted[1], folder)
    with (folder / "steps.jsonl").open("ab") as file:
        file.write(b"\xff\xfe{}\n" + b'{"frame": 2}\n')
    execute(interrupted[0], folder, resume=True, progress=lambda what, *_: said.append(what))
    assert any("line 3 is damaged or of another run" in one and "2 frames are kept" in one for one in said)
    assert [row["frame"] for row in poses(folder)] == ["0", "1", "2", "3"]
    assert "line 3 is damaged" in (folder / "log.txt").read_text()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_first_signal_lets_frame_and_report_be_finished(number, run, tmp_path):
    def press(what: str, done: int = 0, total: int = 0, detail: str = "") -> None:
        if what == "tracking" and done == 2:
            os.kill(os.getpid(), number)

    handlers = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    result = execute(replace(run, passes=1), tmp_path / "out", progress=press)
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == handlers
    assert result.interrupted
    assert result.n_frames in (2, 3)  # one more, if the signal comes after the question
    assert {path.name for path in result.folder.iterdir()} == set(RESULTS)
    assert len(poses(result.folder)) == result.n_frames


def test_a_signal_between_two_passes_leaves_what_the_first_has_found(plain, whole, tmp_path):
    def press(what: str, done: int = 0, total: int = 0, detail: str = "") -> None:
        if what.startswith("forwards: frame 2,"):
            os.kill(os.getpid(), signal.SIGINT)

    result = execute(plain, tmp_path / "out", progress=press)
    assert result.interrupted
    assert [row["frame"] for row in poses(result.folder)] == ["0", "1", "2"]
    assert (result.folder / "steps.jsonl").read_bytes() == b""  # all of it is to be tracked both ways yet
    execute(plain, tmp_path / "out", resume=True)
    for name in ("poses.csv", "joints.csv"):
        assert (tmp_path / "out" / name).read_bytes() == (whole.folder / name).read_bytes()


def test_the_second_signal_leaves_whole_files(run, tmp_path):
    def press(what: str, done: int = 0, total: int = 0, detail: str = "") -> None:
        if (what == "tracking" and done == 2) or what == "writing the results":
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        execute(replace(run, passes=1), tmp_path / "out", progress=press)
    left = {path.name for path in (tmp_path / "out").iterdir()}
    assert left <= set(RESULTS)
    assert {"poses.csv", "steps.jsonl", "run.json"} <= left
    assert len(poses(tmp_path / "out")) == len((tmp_path / "out" / "steps.jsonl").read_text().splitlines())


def test_a_run_whose_start_cannot_be_found_leaves_nothing(run, tmp_path):
    """The first frames fail, so nothing was computed."""
    lost = replace(run, initialization=GivenInitialization(poses=tmp_path / "start.csv"))
    (tmp_path / "start.csv").write_text("frame,person\n0,somebody_else\n")
    with pytest.raises(TrackerError, match="no start pose of person"):
        execute(replace(lost, loss=LossRule(start_within=1)), tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["start.csv"]


def test_interrupted_before_the_first_frame_nothing_is_left(run, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        execute(run, tmp_path / "out", progress=interrupt_after(0))
    assert list(tmp_path.iterdir()) == []
