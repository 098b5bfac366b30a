"""Runs that are killed are resumed to the same bytes (`scripts/fuzz.py kills` for fifty of them, at any instant)."""

from __future__ import annotations

from pathlib import Path

from fuzzing.kills import difference, killed_behind, run_of
from typer.testing import CliRunner

from tracker.running.cli import app
from tracker.synthesis.simulation.sequence import Recipe, write_sequence

N_FRAMES = 6

SETTINGS = """passes = 1
evidence = "contours"
inspection = false
recordings = { report = false, plots = false }
"""
"""Two figures, the report and the look at first frames are left out: they are made at once, of what is complete."""


def run_here(config: Path, output: Path, *more: str) -> None:
    """The run to its end in this process, which has imported what it needs."""
    done = CliRunner().invoke(app, run_of(config, output, *more)[3:])
    assert done.exit_code == 0, done.output


def test_kills_between_frames_change_nothing(tmp_path: Path) -> None:
    """Each when some frames are kept, so that what is resumed must go on with what is there."""
    config = write_sequence(Recipe("arm_swing", seconds=N_FRAMES / 25, size=(256, 208)), tmp_path / "sequence")
    text = config.read_text(encoding="utf-8").replace("[reading]", "[reading]\ndownscale = 1")
    config.write_text(SETTINGS + text, encoding="utf-8")
    run_here(config, tmp_path / "whole")
    output = tmp_path / "killed"
    for n_frames in (2, 4):
        assert killed_behind(config, output, n_frames, 300.0) >= n_frames
    run_here(config, output, "--resume")
    assert difference(tmp_path / "whole", output) == ""
