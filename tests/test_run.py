"""Runs on disk: results, interruption, resumption."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import pytest

from tracker.errors import ConfigError, SequenceError
from tracker.run import Run, SilentObserver, execute, load_run, run_from, with_frames
from tracker.simulation.sequence import Recipe, write_sequence
from tracker.trajectory import Step

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
]


class Interrupter(SilentObserver):
    """Presses Ctrl-C after some frames."""

    def __init__(self, after: int) -> None:
        super().__init__()
        self.left = after

    def stepped(self, step: Step) -> None:
        self.left -= 1
        if self.left == 0:
            raise KeyboardInterrupt


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Six frames of a simulated recording, started from its own truth."""
    folder = tmp_path_factory.mktemp("run") / "sequence"
    config = write_sequence(Recipe("arm_swing", seconds=0.24, size=(360, 288)), folder)
    return load_run(config, ["initialization.use=given", "initialization.poses=truth_poses.csv"])


def poses(folder: Path) -> list[dict[str, str]]:
    with (folder / "poses.csv").open() as file:
        return list(csv.DictReader(file))


def test_a_run_leaves_all_its_results(run, tmp_path):
    result = execute(run, tmp_path / "out")
    assert sorted(path.name for path in result.folder.iterdir()) == sorted(RESULTS)
    assert (result.n_frames, result.n_lost, result.interrupted) == (6, 0, False)
    assert {path.name for path in result.files} == set(RESULTS) - {"log.txt"}
    assert result.files[0].name == "poses.csv"
    saved = json.loads((result.folder / "run.json").read_text())
    assert saved["complete"]
    assert set(saved["inputs"]) >= {str(run.persons[0].model)}
    assert run_from(saved["config"], "run.json", Path("/"), "") == run


def test_an_interrupted_run_resumes_to_the_same_result(run, tmp_path):
    whole = execute(run, tmp_path / "whole")
    part = execute(run, tmp_path / "part", observer=Interrupter(after=3))
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
    result = execute(with_frames(replace(run, recordings=()), 0, 1))
    assert (tmp_path / "results" / run.name / "latest").resolve() == result.folder.resolve()


def test_a_range_of_frames_keeps_the_numbers_of_the_recording(run, tmp_path):
    result = execute(with_frames(replace(run, recordings=run.recordings[:1]), 2, 5), tmp_path / "out")
    assert [row["frame"] for row in poses(result.folder)] == ["2", "3", "4"]


def test_the_best_first_search_of_the_paper_runs_alone(run, tmp_path):
    """Lattice steps of 5 degrees and 5 cm leave about half a step in each joint."""
    folder = run.persons[0].model.parent
    table = run.described()
    table["estimation"] = {"use": "best_first"}
    table["evidence"] = {"similarity": {"use": "chamfer", "outliers": "reject"}}
    paper = run_from(table, "paper", folder, "paper")
    result = execute(with_frames(replace(paper, recordings=run.recordings[:1]), 0, 2), tmp_path / "out")
    assert result.n_lost == 0
