"""Commands that calibrate cameras, and that check and convert calibrations."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.table import Table

from tracker.foundation.errors import CalibrationError, ConfigError
from tracker.running.commands import Output, Overrides, Overwrite, ProgressBar, console, done, marked

if TYPE_CHECKING:
    from tracker.cameras.rig import Rig
    from tracker.cameras.rig_layouts import RigFile
    from tracker.foundation.arrays import Image
    from tracker.running.floors import Floor

# Written out, for the folder's import takes longer than `--help` should; a test compares.
LAYOUTS = "anipose, caliscope, easymocap, freemocap, json, middlebury, opencap, opencv, panoptic, pose2sim, "
LAYOUTS += "qualisys, vicon"

Size = Annotated[str | None, typer.Option(help="Image size WxH, if the calibration does not have it.")]
Units = Annotated[
    str | None, typer.Option(help="Unit of the calibration's lengths (m, cm, mm, in, ft); default: the file's.")
]
Scale = Annotated[float, typer.Option(help="Factor for lengths that have no unit.")]

SEEN = "What lies or stands on the floor: a result folder (resting feet), a run.toml with keypoints, or pictures of "
SEEN += "a board or markers on the floor, such as floor/{view}.png."

AUTO = "auto"
"""Value of --floor that takes the floor from --seen."""

rig_app = typer.Typer(no_args_is_help=True, help="Checks and converts calibrations.")


@rig_app.command("check")
def rig_check(
    rig: Annotated[Path, typer.Argument(help="Calibration, in any layout that `rig convert` reads.")],
    images: Annotated[str | None, typer.Option(help="Pictures such as first/{view}.png: draws epipolar lines.")] = None,
    points: Annotated[Path | None, typer.Option(help="CSV: VIEW_u, VIEW_v and, for the scale, x, y, z.")] = None,
    floor: Annotated[str | None, typer.Option(help=f"Proposes the floor and the upward axis. {SEEN}")] = None,
    picture: Annotated[Path, typer.Option(help="Picture of the epipolar lines.")] = Path("epipolar.png"),
    size: Size = None,
    units: Units = None,
    scale: Scale = 1.0,
) -> None:
    """Checks a rig: geometry, visibility, reprojection, scale, and epipolar lines over the views."""
    from tracker.cameras.calibration import read_points
    from tracker.cameras.rig_check import check_points, check_rig, epipolar_picture
    from tracker.cameras.rig_layouts import read_rig
    from tracker.images.film import write_picture

    opened = read_rig(rig, _pixels(size), units, scale)
    _tell(opened)
    told = f"{rig}: layout {opened.layout}, lengths in {opened.unit}" + ("" if scale == 1 else f" times {scale:g}")
    console.print(told, highlight=False, soft_wrap=True)
    loaded = opened.rig
    found = check_rig(loaded)
    cameras = Table("camera", "position m", "field deg", "tilt deg", "distortion px", title="cameras")
    for check in found.cameras:
        place = ", ".join(f"{value:.2f}" for value in check.position_m)
        field = f"{check.field_deg[0]:.0f} x {check.field_deg[1]:.0f}"
        cameras.add_row(check.name, place, field, f"{check.tilt_deg:.0f}", f"{check.distortion_px:.1f}")
    console.print(cameras)
    pairs = Table("camera", "camera", "distance m", "angle deg", "shared view", title="pairs")
    for pair in found.pairs:
        numbers = f"{pair.distance_m:.3f}", f"{pair.angle_deg:.0f}", f"{100 * pair.shared:.0f} %"
        pairs.add_row(pair.first, pair.second, *numbers)
    console.print(pairs)
    if math.isfinite(found.sigma_mm):
        told = f"a point in the middle is known to {found.sigma_mm:.1f} mm from images of 0.5 px"
        console.print(told, highlight=False)
    if points is not None:
        beside = check_points(loaded, *read_points(points, loaded.names))
        views = ", ".join(f"{name} {value:.2f}" for name, value in beside.rms_px.items())
        console.print(f"reprojection of {beside.n_points} points, RMS px: {views}", highlight=False)
        if beside.scale is not None:
            console.print(f"scale: measured distances are {beside.scale:.5f} times the known ones", highlight=False)
    for doubt in found.doubts:
        console.print(marked("look", doubt), highlight=False, soft_wrap=True)
    if floor is not None:
        _tell_floor(loaded, floor, f"`bodytrack rig convert {rig} NEW.toml --floor {AUTO} --seen {floor}` sets it")
    if images is not None:
        write_picture(picture, epipolar_picture(loaded, _pictures(images, loaded.names)))
        console.print(f"epipolar lines: {picture}", highlight=False, soft_wrap=True)


def _tell_floor(rig: Rig, seen: str, advice: str = "") -> Floor:
    """The floor that --seen shows; prints how it was found."""
    from tracker.running.floors import found_floor

    found = found_floor(rig, seen, lambda pattern: _pictures_there(pattern, rig.names))
    for line in found.told():
        console.print(line, highlight=False, soft_wrap=True)
    if advice:
        console.print(advice, highlight=False, soft_wrap=True)
    return found.floor


def _pictures(pattern: str, names: tuple[str, ...]) -> tuple[Image, ...]:
    """A picture of each view, or the first frame of a film.

    Raises:
        CalibrationError: a picture is missing, or a file is not a picture.
    """
    paths = _paths(pattern, names)
    missing = next((name for name, path in paths.items() if not path.is_file()), None)
    if missing is not None:
        raise CalibrationError(f'view "{missing}": no file {paths[missing]}')
    return tuple(_picture(path, name) for name, path in paths.items())


def _pictures_there(pattern: str, names: tuple[str, ...]) -> tuple[Image | None, ...]:
    """As `_pictures`, with None for each view without a file.

    Raises:
        CalibrationError: no view has a picture, or a file is not a picture.
    """
    paths = _paths(pattern, names)
    if not any(path.is_file() for path in paths.values()):
        raise CalibrationError(f"{pattern}: no such file for any of the views {', '.join(names)}")
    return tuple(_picture(path, name) if path.is_file() else None for name, path in paths.items())


def _paths(pattern: str, names: tuple[str, ...]) -> dict[str, Path]:
    if "{view}" not in pattern and len(names) > 1:
        raise CalibrationError(f"{pattern}: no {{view}} in it, so all {len(names)} views would show the same")
    return {name: Path(pattern.replace("{view}", name)) for name in names}


def _picture(path: Path, name: str) -> Image:
    from tracker.images.reading.images import intact_image
    from tracker.images.reading.video import open_clip

    still = path.suffix.lower() in (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
    image = intact_image(path) if still else open_clip(path, name)[2].read(0)
    if image is None:
        raise CalibrationError(f"{path}: holds no image")
    return image


@rig_app.command("convert")
def rig_convert(
    source: Annotated[Path, typer.Argument(help=f"File or folder; the program finds its layout: {LAYOUTS}.")],
    target: Annotated[Path, typer.Argument(help="File; or folder, for opencv and easymocap.")],
    layout: Annotated[str | None, typer.Option(help="Layout of the target; default: by its name.")] = None,
    size: Size = None,
    units: Units = None,
    scale: Scale = 1.0,
    upright: Annotated[
        bool, typer.Option("--upright", help="Rig for images turned by quarters until up is up.")
    ] = False,
    up: Annotated[
        str,
        typer.Option(
            help="Axis up in the source: x, y, z, -x, -y, -z; or cameras: the upward direction of the cameras."
        ),
    ] = "z",
    floor: Annotated[
        str,
        typer.Option(help=f"Height of the floor along that axis, metres; becomes z = 0. {AUTO}: as --seen shows."),
    ] = "0",
    seen: Annotated[str | None, typer.Option(help=f"For --floor {AUTO}. {SEEN}")] = None,
) -> None:
    """Converts a calibration from and for other programs."""
    from tracker.cameras.rig_layouts import read_rig, save_rig

    floor_m = _floor_m(floor, up, seen)
    opened = read_rig(source, _pixels(size), units, scale)
    _tell(opened, but="--up" if up != "z" or seen is not None else "")
    rig = opened.rig.with_up(up, floor_m) if seen is None else _tell_floor(opened.rig, seen).laid(opened.rig)
    if upright:
        rig = _upright(rig)
    for cost in save_rig(rig, target, layout):
        console.print(marked("look", cost), highlight=False, soft_wrap=True)
    console.print(f"{len(rig)} cameras written to {target}", highlight=False, soft_wrap=True)


def told_rig(path: Path, size: str | None = None) -> Rig:
    """Reads a rig of any layout; prints what was read.

    Args:
        path: file or folder.
        size: image size WxH, if the file does not have it.

    Raises:
        CalibrationError: it cannot be used.
        ConfigError: the size is not of the form WxH.
    """
    from tracker.cameras.rig_layouts import read_rig

    opened = read_rig(path, _pixels(size))
    _tell(opened)
    return opened.rig


def _floor_m(floor: str, up: str, seen: str | None) -> float:
    """Metres of `--floor`; 0 if --seen gives the floor.

    Raises:
        ConfigError: it is not a number, or options do not belong together.
    """
    if floor == AUTO and seen is None:
        raise ConfigError(f"--floor {AUTO} needs --seen RESULT, --seen run.toml or --seen PICTURES")
    if seen is not None and (floor != AUTO or up != "z"):
        raise ConfigError(f"--seen gives the floor and the upward axis: expected --floor {AUTO}, and no --up")
    try:
        metres = 0.0 if floor == AUTO else float(floor)
    except ValueError:
        metres = math.nan
    if not math.isfinite(metres):
        raise ConfigError(f"--floor {floor}: expected metres along the upward axis, or {AUTO}")
    return metres


def _pixels(size: str | None) -> tuple[int, int] | None:
    """Width and height of WxH."""
    if size is None:
        return None
    width, cross, height = size.partition("x")
    if not (cross and width.isdigit() and height.isdigit()):
        raise ConfigError(f"--size {size}: expected for instance 1920x1080")
    return int(width), int(height)


def _upright(rig: Rig) -> Rig:
    """The cameras of images that were turned upright; prints which."""
    from tracker.cameras.rig import Rig

    turned = Rig(tuple(camera.turned(camera.quarters_to_upright) for camera in rig.cameras))
    for before, after in zip(rig.cameras, turned.cameras, strict=True):
        if before.quarters_to_upright:
            turn = f"turned clockwise by {90 * before.quarters_to_upright} degrees"
            console.print(f"{after.name}: for images {turn}, {after.size[0]}x{after.size[1]} px", highlight=False)
    return turned


def _tell(opened: RigFile, but: str = "") -> None:
    """Warnings about the file, except advice that the options already follow."""
    for line in opened.told():
        if but and but in line:
            continue
        console.print(marked("look", line), highlight=False, soft_wrap=True)


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
    from tracker.running.drafts.configuration import draft_calibration

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
    dictionary: Annotated[
        str, typer.Option(help="Dictionary of the markers, for instance 5x5_50, apriltag_36h11.")
    ] = "4x4_50",
    paper: Annotated[str, typer.Option(help="a4, a3, a2, a1, a0, letter, tabloid.")] = "a4",
    plain: Annotated[bool, typer.Option("--plain", help="A chessboard without markers.")] = False,
    inverted: Annotated[bool, typer.Option("--inverted", help="White on black.")] = False,
    both_sides: Annotated[
        bool, typer.Option("--both-sides", help="Add a second page: the mirror image, for the back.")
    ] = False,
    overwrite: Overwrite = False,
) -> None:
    """Draws a board to print, true to scale, with rulers to check it and the lines that calibrate needs."""
    from tracker.cameras.calibration import BoardPrint, board_pattern, largest_square_mm, write_board
    from tracker.foundation.errors import ConfigError
    from tracker.foundation.files import check_free

    if plain and both_sides:
        raise ConfigError("--both-sides: a plain chessboard looks the same from both sides; leave --plain out")
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
