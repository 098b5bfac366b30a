"""The commands that calibrate cameras."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from tracker.running.commands.calibrate_init import calibrate_board, calibrate_init
from tracker.running.commands.options import Output, Overrides, done
from tracker.running.commands.terminal import console

calibrate_app = typer.Typer(no_args_is_help=True, help="Calibrates cameras: from a bar, a board, or measured points.")

calibrate_app.command("init")(calibrate_init)
calibrate_app.command("board")(calibrate_board)

Kind = Literal["reference_bar", "chessboard", "scene_points"]

Config = Annotated[Path, typer.Argument(help="Configuration, TOML; see configs/calibration/.")]


@calibrate_app.command("bar")
def calibrate_bar(config: Config, output: Output = None, set_: Overrides = None) -> None:
    """From a bar with two targets a known distance apart, moved through the volume."""
    _calibrate(config, "reference_bar", output, set_)


@calibrate_app.command("chessboard")
def calibrate_chessboard(config: Config, output: Output = None, set_: Overrides = None) -> None:
    """From a chessboard or ChArUco board moved before the cameras."""
    _calibrate(config, "chessboard", output, set_)


@calibrate_app.command("points")
def calibrate_points(config: Config, output: Output = None, set_: Overrides = None) -> None:
    """From points in the scene whose positions were measured."""
    _calibrate(config, "scene_points", output, set_)


def _calibrate(config: Path, kind: Kind, output: Path | None, overrides: list[str] | None) -> None:
    from tracker.cameras.calibration import report_text
    from tracker.running.jobs.calibrate import load_calibration

    job = load_calibration(config, kind, overrides or [])
    outcome = done(job, output)
    console.print(report_text(job.name, outcome.calibrated), highlight=False, soft_wrap=True)
    told = f"rig: {outcome.folder / 'rig.toml'}, report: {outcome.folder / 'report.html'}"
    console.print(told, highlight=False, soft_wrap=True)
