"""Runs of recordings whose views are out of step: what they say, resume to, and what is made of them."""

from __future__ import annotations

import html
import json
import shutil

import numpy as np
import pytest
from test_alignment import DELAYS_S, FPS
from test_run import killed_after
from typer.testing import CliRunner

from tracker.acquisition.calibrated_views import ViewSettings
from tracker.acquisition.fitting import FitSettings
from tracker.cameras.rig_layouts import load_rig
from tracker.results.evaluation.joints import read_joints
from tracker.results.result import load_result
from tracker.running.cli import app
from tracker.running.viewing.images import reading_of
from tracker.synthesis.simulation.sequence import Recipe, write_sequence

GIVEN = (
    "initialization.use=given",
    "initialization.poses=truth_poses.csv",
    "persons.0.carries=[]",
    "evidence=contours",
    "passes=1",
    "reading.in_step=off",
)
"""What runs need not find out here; the start is where the person is when the first view looks."""


FITTED = "persons.0.shape=recording", "recordings=[{use='csv_table'},{use='journal'},{use='run_json'}]"


def ran(config, output, *settings, options=()):
    """What the command prints."""
    words = [*options, *(word for setting in (*GIVEN, *settings) for word in ("--set", setting))]
    done = CliRunner().invoke(app, ["run", str(config), "--output", str(output), *words])
    assert done.exit_code == 0, done.output
    return " ".join(done.output.split())


@pytest.fixture(scope="module", autouse=True)
def few_steps():
    """Bodies are fitted in few steps."""
    few = ViewSettings(frames=4, rounds=1, fit=FitSettings(iterations=4, pose_deg=8.0, pose_m=0.05, rigid_share=0.2))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tracker.running.jobs._persons.ViewSettings", lambda: few)
        yield


@pytest.fixture(scope="module")
def run_out_of_step(tmp_path_factory):
    """A run of a recording whose views are out of step, with its body fitted to it."""
    folder = tmp_path_factory.mktemp("late")
    recipe = Recipe(
        "walking_on_the_spot", seconds=2.4, fps=FPS, delays_s=DELAYS_S, size=(360, 288), constant_rate_factor=10
    )
    config = write_sequence(recipe, folder / "recording")
    return folder / "result", ran(config, folder / "result", *FITTED)


def test_a_run_tells_that_views_are_out_of_step(run_out_of_step):
    folder, output = run_out_of_step
    assert "input: views are out of step with" in output
    assert any("out of step" in line for line in json.loads((folder / "run.json").read_text())["findings"])


def test_a_run_whose_bodies_are_not_fitted_is_asked_at_its_end(run_out_of_step, tmp_path):
    """Also then its files say so."""
    folder, _ = run_out_of_step
    outputs = "recordings=[{use='csv_table'},{use='report'},{use='run_json'}]"
    recording = folder.parent / "recording" / "config.toml"
    ran(recording, tmp_path / "result", "persons.0.shape=model", "reading.downscale=1", outputs)
    findings = json.loads((tmp_path / "result" / "run.json").read_text())["findings"]
    (told,) = (line for line in findings if "of step" in line)
    assert told in html.unescape((tmp_path / "result" / "report.html").read_text())


def test_the_command_writes_poses_at_one_moment_and_a_rig(run_out_of_step, tmp_path, monkeypatch):
    folder, _ = run_out_of_step
    done = CliRunner().invoke(app, ["result", "align", str(folder), "--rig", str(tmp_path / "turned.toml")])
    assert done.exit_code == 0, done.output
    assert "out of step" in done.output
    assert "poses at the moment of" in done.output
    result = load_result(folder / "in_step")
    assert len(result.frames) == 30
    shutil.copytree(folder / "in_step", tmp_path / "elsewhere" / "in_step")
    monkeypatch.chdir(folder / "in_step")
    raw, *others = (
        reading_of(load_result(p)) for p in (folder, folder / "in_step", ".", tmp_path / "elsewhere/in_step")
    )
    assert others == [raw] * 3, "wherever they lie, and from wherever they are asked for"
    late = [view["late_ms"] for view in result.details["alignment"].values()]
    assert late == pytest.approx([1000 * delay for delay in DELAYS_S], abs=4)
    assert load_rig(tmp_path / "turned.toml").names == result.rig.names
    rows = (tmp_path / "turned.toml").read_bytes()
    rig_there = ["--rig", str(tmp_path / "turned.toml"), "--output", str(tmp_path / "other")]
    again = CliRunner().invoke(app, ["result", "align", str(folder), *rig_there])
    assert again.exit_code != 0
    assert "not there yet" in str(again.exception)
    assert (tmp_path / "turned.toml").read_bytes() == rows
    again = CliRunner().invoke(app, ["result", "align", str(folder), "--rig", str(tmp_path / "another.toml")])
    assert "in_step is not empty: choose another --output" in str(again.exception)
    assert "views, by" not in again.output, "refused before the views are compared"
    assert not (tmp_path / "another.toml").exists()


@pytest.fixture(scope="module")
def run_brought(run_out_of_step, tmp_path_factory):
    """The same run, which may bring its poses to one moment."""
    recording = run_out_of_step[0].parent / "recording" / "config.toml"
    folder = tmp_path_factory.mktemp("brought") / "result"
    return folder, ran(recording, folder, *FITTED, "reading.in_step=auto")


def off_mm(folder, truth):
    """Of the joints of a result on average, without those of its first and last frames."""
    found = read_joints(folder / "joints.csv").persons["person1"]
    true = read_joints(truth).persons["person1"]
    gaps = [np.array(found[t][name]) - true[t][name] for t in range(3, 27) for name in found[t] if name in true[t]]
    return 1000 * np.linalg.norm(gaps, axis=1).mean()


def test_a_run_brings_its_poses_to_one_moment(run_out_of_step, run_brought):
    (before, _), (folder, output) = run_out_of_step, run_brought
    truth = before.parent / "recording" / "truth_joints.csv"
    assert "poses are those of the first view's moment" in output
    late = [view["late_ms"] for view in json.loads((folder / "run.json").read_text())["alignment"].values()]
    assert late == pytest.approx([1000 * delay for delay in DELAYS_S], abs=10), "by poses of a body not fitted yet"
    assert json.loads((before / "run.json").read_text())["alignment"] == {}
    assert off_mm(folder, truth) < 0.7 * off_mm(before, truth)
    assert len(load_result(folder).frames) == 30


def test_a_resumed_run_goes_on_from_the_poses_as_tracked(run_out_of_step, run_brought, tmp_path):
    folder, _ = run_brought
    part = killed_after(12, folder, tmp_path / "part")
    recording = run_out_of_step[0].parent / "recording" / "config.toml"
    ran(recording, part, *FITTED, "reading.in_step=auto", options=["--resume"])
    assert (part / "poses.csv").read_bytes() == (folder / "poses.csv").read_bytes()
