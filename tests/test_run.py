"""Runs on disk: results, interruption, resumption."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tracker.body_files import load_body
from tracker.cycle import LossRule
from tracker.errors import ConfigError, SequenceError, TrackerError
from tracker.initialization.given import GivenInitialization
from tracker.jobs import described, execute, job_from, load_job
from tracker.jobs.track import TrackJob
from tracker.progress import Progress
from tracker.recording import Recording
from tracker.rig_layouts import load_rig
from tracker.simulation.sequence import Recipe, write_sequence

RESULTS = [
    "poses.csv",
    "sigmas.csv",
    "joints.csv",
    "run.json",
    "steps.jsonl",
    "overlay.mp4",
    "parameters.png",
    "report.html",
    "log.txt",
    "config.toml",
    "models",
    "rig.toml",
]


def interrupt_after(n_frames: int) -> Progress:
    """Presses Ctrl-C after some frames."""

    def progress(what: str, done: int = 0, total: int = 0, detail: str = "") -> None:
        if what == "tracking" and done == n_frames:
            raise KeyboardInterrupt

    return progress


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> TrackJob:
    """Six frames of a simulated recording, started from its own truth."""
    folder = tmp_path_factory.mktemp("run") / "sequence"
    config = write_sequence(Recipe("arm_swing", seconds=0.24, size=(360, 288)), folder)
    return load_job("track", config, ["initialization.use=given", "initialization.poses=truth_poses.csv"])


def part_of(job: TrackJob, start: int, stop: int, recordings: tuple[Recording, ...]) -> TrackJob:
    return replace(job, reading=replace(job.reading, start=start, stop=stop), recordings=recordings)


def poses(folder: Path) -> list[dict[str, str]]:
    with (folder / "poses.csv").open() as file:
        return list(csv.DictReader(file))


def test_a_run_leaves_all_its_results(run, tmp_path):
    result = execute(run, tmp_path / "out")
    assert sorted(path.name for path in result.folder.iterdir()) == sorted(RESULTS)
    assert (result.n_frames, result.doubts.lost, result.interrupted) == (6, (), False)
    assert {path.name for path in result.files} == set(RESULTS) - {"log.txt", "config.toml", "rig.toml", "models"}
    assert result.files[0].name == "poses.csv"
    saved = json.loads((result.folder / "run.json").read_text())
    assert saved["complete"]
    assert set(saved["inputs"]) >= {str(run.persons[0].model)}
    assert job_from("track", saved["config"], "run.json", Path("/"), "") == run


def test_an_interrupted_run_resumes_to_the_same_result(run, tmp_path):
    whole = execute(run, tmp_path / "whole")
    part = execute(run, tmp_path / "part", progress=interrupt_after(3))
    assert part.interrupted
    assert part.n_frames == 3
    assert len(poses(part.folder)) == 3
    assert not json.loads((part.folder / "run.json").read_text())["complete"]
    with (part.folder / "steps.jsonl").open("a") as file:
        file.write('{"frame": 3, "time_s": 0.1')  # torn by a kill
    resumed = execute(run, tmp_path / "part", resume=True)
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


def test_a_run_is_not_resumed_with_another_configuration(run, tmp_path):
    asked = part_of(run, 0, 2, run.recordings[-1:])
    execute(asked, tmp_path / "out", progress=interrupt_after(1))
    before = (tmp_path / "out" / "steps.jsonl").read_bytes()
    with pytest.raises(ConfigError, match=r"reading.stop = 2, but 3 is asked for: resume with what it was made with"):
        execute(part_of(run, 0, 3, run.recordings[-1:]), tmp_path / "out", resume=True)
    assert (tmp_path / "out" / "steps.jsonl").read_bytes() == before


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
