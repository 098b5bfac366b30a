"""The commands that calibrate cameras."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console

from tracker.commands.warmup import prepare_kernels
from tracker.progress import CountedProgress

calibrate_app = typer.Typer(no_args_is_help=True, help="Calibrates cameras: from a bar, a board, or measured points.")
console = Console()

Kind = Literal["reference_bar", "chessboard", "scene_points"]

Config = Annotated[Path, typer.Argument(help="Configuration, TOML; see configs/calibration/.")]
Output = Annotated[Path | None, typer.Option(help="Result folder; default results/NAME/TIME.")]
Overrides = Annotated[list[str] | None, typer.Option("--set", help="Override: section.key=value; repeatable.")]


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
    # figures and detectors take long to import, which `bodytrack --help` need not wait for
    from tracker.calibrate import calibrate, load_calibration
    from tracker.calibration import report_text

    run = load_calibration(config, kind, overrides or [])
    prepare_kernels("calibration")
    with CountedProgress(console) as progress:
        result = calibrate(run, output, progress.told)
    console.print(report_text(run.name, result.calibrated), highlight=False, markup=False)
    console.print(f"rig: {result.folder / 'rig.toml'}, report: {result.folder / 'report.html'}", highlight=False)
