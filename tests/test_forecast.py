"""A dry run: all that a run does, with a few frames, and nothing is left."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import av
import cv2
import pytest
from typer.testing import CliRunner

from tracker.foundation.configuration.tables import read_config
from tracker.foundation.errors import ConfigError, TrackerError
from tracker.running.cli import app
from tracker.running.jobs import job_from, load_job
from tracker.running.jobs.track import TrackJob, TrackOutcome
from tracker.running.programs import Forecast, forecast
from tracker.synthesis.simulation.sequence import Recipe, write_sequence
from tracker.tracking.doubts import Doubts

START = [
    "initialization.use=given",
    "initialization.poses=truth_poses.csv",
    "evidence=contours",
    "estimation=twist_icp",
]
GIVEN = [*START, "reading.stride=2", "smoothing=rts"]
JOURNAL = 'recordings=["journal","run_json"]'
"""Where it is not a matter of what the recordings take."""


@pytest.fixture(scope="module")
def config(tmp_path_factory) -> Path:
    return write_sequence(
        Recipe("arm_swing", seconds=0.4, size=(360, 288)), tmp_path_factory.mktemp("dry") / "sequence"
    )


def test_a_few_frames_tell_of_all_and_nothing_is_left(config, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    seen = []
    told = forecast(
        load_job("track", config, GIVEN), 3, lambda what, done=0, total=0, detail="": seen.append((what, total))
    )
    assert (told.n_frames, told.n_views, told.doubts.n_frames) == (5, 4, 3)
    assert ("tracking", 3) in seen
    assert told.start_s > 0
    assert 0 < told.frame_s < told.seconds
    assert list(tmp_path.iterdir()) == []


def test_frames_in_which_nobody_is_in_view_are_left_out(config, monkeypatch):
    """Of frames 0, 2, ... 8 those from 4 on, with the true start of frame 4."""
    monkeypatch.setattr(TrackJob, "_first_in_view", lambda *_: 4)
    seen = []
    told = forecast(
        load_job("track", config, [*GIVEN, JOURNAL]),
        5,
        lambda what, done=0, total=0, detail="": seen.append((what, total)),
    )
    assert (told.n_frames, told.doubts.n_frames) == (5, 3)
    assert ("tracking", 3) in seen


def test_frames_far_apart_need_none_behind_the_last(config):
    """Frames 0, 3, 6, 9 of ten: what is read ends at the last of them."""
    told = forecast(load_job("track", config, [*START, "reading.stride=3", JOURNAL]))
    assert (told.n_frames, told.doubts.n_frames) == (4, 4)


def test_still_pictures_are_a_single_frame(config, tmp_path):
    for video in config.parent.glob("*.mp4"):
        with av.open(str(video)) as opened:
            image = next(opened.decode(video=0)).to_ndarray(format="bgr24")
        cv2.imwrite(str(tmp_path / f"{video.stem}.png"), image)
    stills = {"use": "stills", "path": str(tmp_path / "{view}.png"), "rig": str(config.parent / "rig.toml")}
    table = read_config(config, [*START, JOURNAL]) | {
        "reading": stills | {"background": str(config.parent / "background" / "{view}.png")}
    }
    told = forecast(job_from("track", table, "stills.toml", config.parent, "stills"))
    assert (told.n_frames, told.doubts.n_frames) == (1, 1)


def test_the_time_is_that_of_the_start_and_of_the_other_frames():
    assert Forecast(101, 4, 5.0, 0.04, Doubts()).seconds == pytest.approx(9.0)
    assert Forecast(101, 4, 5.0, 0.04, Doubts(), 2).seconds == pytest.approx(9.0 + 200 * 0.04 + 20.0)
    assert Forecast(11, 4, 5.0, 0.04, Doubts(), 1).seconds == pytest.approx(5.4 + 22 * 0.04 + 10.0)


def test_who_is_scaled_is_said_to_be_fitted_and_is_not_for_the_forecast(config):
    seen = []
    told = forecast(
        load_job("track", config, [*GIVEN, JOURNAL, "persons.0.stature_m=1.78"]), 3, lambda what, *_: seen.append(what)
    )
    assert told.n_fitted == 1
    assert not any("lengths and shapes" in what for what in seen)


def test_the_command_says_how_long_it_takes(config):
    overrides = [word for one in (*GIVEN, JOURNAL) for word in ("--set", one)]
    told = CliRunner().invoke(app, ["run", str(config), "--dry-run", *overrides])
    assert told.exit_code == 0, told.output
    assert "4 views, 5 frames" in told.output
    assert re.search(r"all of them take about \d+ s on this machine; nothing was written", told.output)
    both = CliRunner().invoke(app, ["run", str(config), "--dry-run", "--resume", *overrides])
    assert isinstance(both.exception, ConfigError)


def test_what_would_end_the_run_is_said(config, tmp_path):
    job = load_job("track", config, ["initialization.use=given", "initialization.poses=nowhere.csv"])
    with pytest.raises(TrackerError, match=r"nowhere\.csv"):
        forecast(job)


@pytest.mark.parametrize("dry", [True, False])
def test_where_nobody_is_found_nothing_is_estimated_and_the_code_says_so(config, monkeypatch, tmp_path, dry):
    """The command ends with 2; one frame in which somebody was found is enough for an estimate."""
    lost = Doubts(n_frames=5, lost=(0, 1, 2, 3, 4), why_unfound="no foreground")
    monkeypatch.setattr("tracker.running.programs.forecast", lambda job, progress: Forecast(5, 4, 1.0, 0.5, lost))
    monkeypatch.setattr("tracker.running.commands.run.done", lambda *_: TrackOutcome(tmp_path, 5, lost))
    told = CliRunner().invoke(app, ["run", str(config), *(["--dry-run"] if dry else [])])
    assert told.exit_code == 2
    assert "nobody was found: no foreground" in told.output
    assert "take about" not in told.output
    some = replace(lost, lost=(0, 1, 2, 3), found=frozenset({"person1"}))
    monkeypatch.setattr("tracker.running.programs.forecast", lambda job, progress: Forecast(5, 4, 1.0, 0.5, some))
    monkeypatch.setattr("tracker.running.commands.run.done", lambda *_: TrackOutcome(tmp_path, 5, some))
    assert CliRunner().invoke(app, ["run", str(config), *(["--dry-run"] if dry else [])]).exit_code == 0
