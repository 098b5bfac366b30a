"""The commands that calibrate cameras."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from tracker.running.commands.terminal import Output, Overrides, Overwrite, ProgressBar, console, done

SquareM = Annotated[float | None, typer.Option("--square", min=0.001, max=1.0, help="Side of a square, metres.")]


def calibrate_init(
    videos: Annotated[Path, typer.Argument(help="Folder of the videos or images of a board, one a camera.")],
    output: Annotated[Path, typer.Option(help="Configuration to write.")] = Path("calibration.toml"),
    square: SquareM = None,
) -> None:
    """Finds the board in recordings (size, dictionary, inverted, legacy, both sides), and writes calibration.toml."""
    from tracker.foundation.configuration.schema import schema_of_job
    from tracker.foundation.files import write_json, write_whole
    from tracker.running.commands.configuration import check_new_configuration
    from tracker.running.drafts.calibration import draft_calibration

    schema = check_new_configuration(output)
    with ProgressBar() as progress:
        found = draft_calibration(videos, output, square, progress)
    write_json(schema, schema_of_job("calibrate"))
    write_whole(output, found.text)
    for one in found.footage:
        seen = f"the board in {found.board.n_seen[one.view]} of {found.board.n_pictures[one.view]} pictures"
        console.print(f"{one.view}: {one.size[0]}x{one.size[1]} px, {seen}", highlight=False, soft_wrap=True)
    for remark in found.remarks:
        console.print(remark, style="yellow", highlight=False, soft_wrap=True)
    told = f"{output} written; `bodytrack calibrate chessboard {output}` calibrates"
    console.print(told, highlight=False, soft_wrap=True)


def calibrate_board(
    output: Annotated[Path, typer.Argument(help="PDF to write.")] = Path("board.pdf"),
    columns: Annotated[int | None, typer.Option(min=3, max=60, help="Squares in a row; plain: inner corners.")] = None,
    rows: Annotated[int | None, typer.Option(min=3, max=60, help="Rows of them.")] = None,
    square: SquareM = None,
    marker: Annotated[float, typer.Option(min=0.3, max=0.95, help="Side of a marker, share of a square.")] = 0.75,
    dictionary: Annotated[str, typer.Option(help="Of the markers, for instance 5x5_50, apriltag_36h11.")] = "4x4_50",
    paper: Annotated[str, typer.Option(help="a4, a3, a2, a1, a0, letter, tabloid.")] = "a4",
    plain: Annotated[bool, typer.Option("--plain", help="A chessboard without markers.")] = False,
    inverted: Annotated[bool, typer.Option("--inverted", help="White on black.")] = False,
    both_sides: Annotated[bool, typer.Option("--both-sides", help="A second page: the same seen through.")] = False,
    overwrite: Overwrite = False,
) -> None:
    """Draws a board to print, true to scale, with rulers to check that, and the lines that calibrate needs."""
    from tracker.cameras.calibration import BoardPrint, board_pattern, largest_square_mm, write_board
    from tracker.foundation.errors import ConfigError
    from tracker.foundation.files import check_free

    if plain and both_sides:
        raise ConfigError("--both-sides: a plain chessboard does not tell its sides; leave --plain out")
    if output.suffix.lower() != ".pdf" or not output.resolve().parent.is_dir():
        raise ConfigError(f"{output}: expected a .pdf in a folder that exists")
    check_free([output], overwrite)
    size = columns or (9 if plain else 5), rows or (6 if plain else 7)
    pattern = board_pattern(size, None if plain else marker, dictionary, inverted)
    square_mm = largest_square_mm(pattern, paper.lower()) if square is None else 1000 * square
    board = BoardPrint(pattern, square_mm, paper.lower(), both_sides)
    write_board(output, board)
    for line in board.lines.splitlines():
        console.print(f"  {line}", highlight=False)
    console.print(
        f"{output}: print it at 100 % (actual size), measure its scales and ten squares: square_m is what you measure",
        highlight=False,
        soft_wrap=True,
    )


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
