"""A following that Ctrl-C stops: what it keeps, and what the command says."""

from __future__ import annotations

import signal
from dataclasses import dataclass

from test_follow_job import folder, frames, outcome, rig
from typer.testing import CliRunner

from tracker.running.cli import app
from tracker.running.jobs import _following, execute, load_job

__all__ = ["folder", "frames", "outcome", "rig"]


def test_ctrl_c_saves_the_state_that_the_job_goes_on_from(folder, outcome, monkeypatch):
    out, written = folder / "stopped", _following.append

    def stopped(path, frame):
        written(path, frame)
        if frame.index == 4:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(_following, "append", stopped)
    job = load_job("follow", folder / "follow.toml", ("saved_frames=100",))
    told = execute(job, out)
    assert (told.interrupted, told.n_frames) == (True, 5)
    monkeypatch.setattr(_following, "append", written)
    assert execute(job, out, resume=True).n_frames == outcome.n_frames
    for name in ("points.bin", "trajectories.csv"):
        assert (out / name).read_bytes() == (outcome.folder / name).read_bytes()


def test_ctrl_c_before_the_first_frame_leaves_nothing(folder, monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("tracker.running.jobs._following.measure_surface", stopped)
    told = CliRunner().invoke(app, ["follow", str(folder / "follow.toml"), "--output", str(folder / "at_once")])
    assert told.exit_code == 130, told.output
    assert not (folder / "at_once").exists()


@dataclass
class Outcome:
    interrupted: bool = True


def test_an_interrupted_job_ends_with_the_code_of_ctrl_c(folder, monkeypatch):
    monkeypatch.setattr("tracker.running.cli.done", lambda *_: Outcome())
    told = CliRunner().invoke(app, ["follow", str(folder / "follow.toml")])
    assert told.exit_code == 130, told.output
