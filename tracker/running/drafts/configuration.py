"""Drafts of configurations: of a run, from a folder of recordings; of a calibration, from pictures of a board."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import tomli_w

from tracker.bodies.keypoint_layouts.views import USUAL
from tracker.bodies.subject import UNMEASURED
from tracker.cameras.calibration import FoundBoard, found_board
from tracker.cameras.rig import told_world, world_doubts
from tracker.foundation.configuration.schema import SCHEMA
from tracker.foundation.errors import CalibrationError, SequenceError
from tracker.foundation.progress import Progress, silent
from tracker.images.footage import FRAME, Footage, board_sources, header, pattern_of, sources, spread_pictures
from tracker.running.drafts.inputs import FoundRig, found_keypoints, found_plates, found_rigs, given_rig

_PLAIN = "images", "frames", "pictures", "raw"


_TRIALS_VIDEOS = "videos", "synchronized_videos"
"""Folder of the videos in a trial of Pose2Sim, and of FreeMoCap."""


@dataclass(frozen=True)
class Draft:
    """The files found, and the text of the configuration."""

    footage: tuple[Footage, ...]
    rig: Path | None
    plates: str
    """Pattern with `{view}`; empty if there are none."""

    keypoints: str
    """Pattern of the folders of 2-D keypoints; empty if there are none."""

    world: str
    """Height of the floor in the calibration; empty if it has none."""

    remarks: tuple[str, ...]
    """Warnings: missing or unsuitable files, one line each."""

    text: str
    """The commented configuration."""


def draft(folder: Path, target: Path, rig: Path | None = None) -> Draft:
    """Finds videos, cameras and plates, and writes a configuration for them.

    Args:
        folder: of the videos or numbered images, one a view; or with a folder of images, or of videos, for each view.
        target: path of the configuration; paths in it start at its folder.
        rig: the calibration; None to search in the folder and beside it.

    Raises:
        SequenceError: there are no videos or images, or one cannot be read.
        CalibrationError: the given calibration cannot be used, or no file is named after its cameras.
    """
    folder = _of_videos(folder)
    there = sources(folder)
    rigs, faults = ([given_rig(rig, there, folder)], []) if rig is not None else found_rigs(folder, there)
    found = rigs[0] if rigs else None
    pattern, views = (found.pattern, found.views) if found else pattern_of(there, folder, None)
    if not views and found is not None:
        cameras, files = ", ".join(found.rig.names), ", ".join(path.name for path in there[:4])
        raise CalibrationError(
            f"{found.path}: no file in {folder} is named after one of its cameras ({cameras}): {files}; rename files "
            "or cameras, or give a table, path = { camera = FILE, ... }"
        )
    footage = tuple(header(path, view) for view, path in sorted(views.items()))
    plates = found_plates(folder, footage)
    keypoints = found_keypoints(folder, footage)
    remarks = (
        *faults,
        *_remarks(footage, found, sorted(set(there) - set(views.values()))),
        *_others("calibrations", [one.path for one in rigs[1:]], "--rig"),
        *plates.told(),
        *_others("keypoints", keypoints[1:], "`keypoints`"),
    )
    start = target.resolve().parent
    near = {"rig": found.path if found else None, "background": plates.pattern if plates.whole else None}
    near["keypoints"] = keypoints[0] if keypoints else None
    told = {key: _relative(path, start) for key, path in near.items() if path is not None}
    if found and found.mapped:
        path: str | dict[str, str] = {view: _relative(source, start) for view, source in views.items()}
    else:
        path = _relative(pattern, start)
    absent = found is not None and set(found.rig.names) > set(views)
    chosen_views = [name for name in found.rig.names if name in views] if found and absent else []
    guessed = found is not None and found.guessed
    others = [_relative(one.path, start) for one in rigs[1:]], [_relative(one, start) for one in plates.others]
    text = _text(_name(folder.resolve()), (path, guessed), told, chosen_views, others)
    world = told_world(found.rig) if found else ""
    return Draft(
        footage,
        found.path if found else None,
        str(plates.pattern or ""),
        str(keypoints[0]) if keypoints else "",
        world,
        remarks,
        text,
    )


def _of_videos(folder: Path) -> Path:
    """The folder itself, or the folder in it where other programs keep a trial's videos."""
    try:
        sources(folder)
    except SequenceError:
        inner = next((folder / name for name in _TRIALS_VIDEOS if (folder / name).is_dir()), None)
        if inner is None:
            raise
        return inner
    return folder


def _others(what: str, paths: list[Path], setting: str) -> Iterator[str]:
    if paths:
        yield f"other {what} there: {', '.join(map(str, paths))}; {setting} chooses one: make sure which is right"


def _remarks(footage: tuple[Footage, ...], found: FoundRig | None, unused: list[Path]) -> Iterator[str]:
    if found is None:
        yield "no calibration found with cameras of the videos' names: name one by --rig, or as `rig`"
    else:
        yield from found.told
        yield from world_doubts(found.rig)
        yield from found.wrong_sizes(footage)
        yield from _named(found)
    if unused:
        yield f"left out, because their names follow another pattern: {', '.join(path.name for path in unused)}"
    different = len({round(one.fps, 2) for one in footage}) > 1
    if different:
        yield (
            "the videos have different frame rates: "
            + ", ".join(f"{one.view} {one.fps:.4g}" for one in footage)
            + "; `bodytrack run THIS --dry-run` says which of them can be read together"
        )
    if any(one.fps == 0 and "{frame}" not in one.path.name for one in footage):
        yield "videos without a container have no clock: set `fps` to the frame rate of the cameras"
    if len({one.n_frames for one in footage}) > 1 and not different:
        yield "the views have different numbers of frames: `offsets` and `stop` make them fit"
    if any("{frame}" in one.path.name for one in footage) or any("{frame}" in path.name for path in unused):
        yield "images have no frame rate: set `fps`"
    if len(footage) == 1:
        yield "one view: at least two are needed, for one does not show how far away a person is"


def _named(found: FoundRig) -> Iterator[str]:
    """Warnings about the names of views and files."""
    if absent := sorted(set(found.rig.names) - set(found.views)):
        yield f"cameras without a recording: {', '.join(absent)}; `views` names the others"
    if found.mapped:
        pairs = ", ".join(f"{view} = {source.name}" for view, source in found.views.items())
        how = "GUESSED by their order: check that each camera has its own" if found.guessed else "by their numbers"
        yield f"the videos are not named after the cameras; {pairs}, {how}; see [reading] path"


def _relative(path: Path, start: Path) -> str:
    return Path(os.path.relpath(path.absolute(), start)).as_posix()


def _name(folder: Path) -> str:
    """Name of the run: that of the folder, or of its parent if the folder is only called "videos" or alike."""
    plain = "video" in folder.name.lower() or folder.name.lower() in _PLAIN
    return folder.parent.name if plain and folder.parent.name else folder.name


def _text(
    name: str,
    path: tuple[str | dict[str, str], bool],
    near: dict[str, str],
    views: list[str],
    others: tuple[list[str], list[str]],
) -> str:
    """The text of the configuration.

    Args:
        name: of the run.
        path: of the recording, a pattern or a table; and whether the table is a guess.
        near: other paths by their keys; missing ones become comments.
        views: the views to use; empty for all.
        others: further calibrations, and plates.
    """
    told = {key: tomli_w.dumps({key: one}).strip() for key, one in near.items()}
    rig_line = told.get("rig", '# rig = "Calib.toml"                    # missing: the calibration of the cameras')
    images = "{frame}" in str(path[0])
    use = 'use = "images"' if images else 'use = "video"'
    rate = "# fps = 25.0              # missing: images have no frame rate\n" if images else ""
    keypoint_line = (
        f"keypoints = {{ path = {_quoted(near['keypoints'])} }}   # 2-D detections: the start and the evidence use them"
        if "keypoints" in near
        else f'# keypoints = {{ path = "{USUAL}" }}   # 2-D detections: `bodytrack detect THIS` makes some'
    )
    chosen = f"views = {_quoted(views)}\n" if views else ""
    plate_line = told.get("background", '# background = "background/{view}.png"  # clean plates; else of the recording')
    rigs, plates = (
        "".join(f"# {key} = {_quoted(one)}   # another one\n" for one in paths)
        for key, paths in zip(("rig", "background"), others, strict=True)
    )
    return f"""\
#:schema ./{SCHEMA}
# Written by `bodytrack init`. `bodytrack run THIS --dry-run` checks it; `bodytrack show jobs` lists what else there is.
{tomli_w.dumps({"name": name}).strip()}
# "human" bends its spine, "gavrila22" is rigid and quicker. The stature scales it: measure the person, with shoes, and
# write metres in place of "{UNMEASURED}", for instance stature_m = 1.75: no run begins before.
persons = [{{ name = "person1", model = "human", stature_m = "{UNMEASURED}" }}]
{keypoint_line}

[reading]
{use}
{_path_lines(*path, images)}
{rate}{rig_line}
{rigs}{chosen}{plate_line}
{plates}# start = 0                 # first frame: one in which everybody stands apart, arms away from the body
# downscale = 2             # images are averaged until persons are some 300 px high, or enlarged (0.5); 1: as is

# smoothing = "rts" above the first section takes away jitter at the end.

[recordings]
overlay = true              # the model over all views; false saves time
# trc = true                # or c3d, osim, mot, bvh, glb, wide_table, isb_angles; also later: `bodytrack result export`
"""


def _path_lines(path: str | dict[str, str], guessed: bool, images: bool) -> str:
    if isinstance(path, str):
        frame = " and {frame} the number of the image" if images else ""
        return f"{tomli_w.dumps({'path': path}).strip()}   # {{view}} is the camera's name in the calibration{frame}"
    pairs = ", ".join(f"{_quoted(view)} = {_quoted(file)}" for view, file in path.items())
    how = "GUESSED by the order of their names: check that each camera has its own" if guessed else "by their numbers"
    return f"# the file of each camera of the calibration, {how}\npath = {{ {pairs} }}"


def _quoted(value: str | list[str]) -> str:
    return json.dumps(value, ensure_ascii=False)


_N_PICTURES = 16
"""Frames of each view to search."""

_N_USED = 400
"""Frames of a long recording for a calibration: 100 to 200 positions of the board are enough."""

_FEWEST_SEEN = 3
"""Number of these pictures in each view that should show the board."""


@dataclass(frozen=True)
class CalibrationDraft:
    """The files found, and the text of the configuration."""

    footage: tuple[Footage, ...]
    board: FoundBoard
    remarks: tuple[str, ...]
    """Warnings: missing or unsuitable files, one line each."""

    text: str
    """The commented configuration."""


def draft_calibration(
    folder: Path, target: Path, square_m: float | None = None, progress: Progress = silent
) -> CalibrationDraft:
    """Finds the board in recordings, and writes a configuration of the calibration.

    Args:
        folder: of the videos or numbered images, one a view.
        target: path of the configuration; paths in it start at its folder.
        square_m: side of the board's squares, metres, which no picture shows; None leaves it open.
        progress: gets the pictures searched.

    Raises:
        SequenceError: there are no videos or images, or one cannot be read.
        CalibrationError: they show no board.
    """
    there = board_sources(folder)
    pattern, views = pattern_of(there, folder, None)
    if not views:
        files = ", ".join(path.name for path in there[:4])
        raise SequenceError(f"{folder}: which file is which camera's? {files}; expected one a camera, called after it")
    footage = tuple(header(path, view) for view, path in sorted(views.items()))
    pictures = {}
    for k, one in enumerate(footage):
        progress("reading pictures", k + 1, len(footage))
        pictures[one.view] = spread_pictures(one.path, _N_PICTURES)
    board = found_board(pictures, progress)
    remarks = (*_board_remarks(board, footage, sorted(set(there) - set(views.values()))), *_missing(square_m))
    start = target.resolve().parent
    path = Path(os.path.relpath(pattern.absolute(), start)).as_posix()
    text = _board_text(folder.resolve().name, path, footage, board, square_m)
    return CalibrationDraft(footage, board, remarks, text)


def _missing(square_m: float | None) -> Iterator[str]:
    if square_m is None:
        yield "no picture shows how long a square is: measure ten of them, and set square_m and marker_m"


def _board_remarks(board: FoundBoard, footage: tuple[Footage, ...], unused: list[Path]) -> Iterator[str]:
    few = [f"{name} ({n})" for name, n in board.n_seen.items() if n < _FEWEST_SEEN]
    if few:
        yield (
            f"few pictures show the board: {', '.join(few)} of {_N_PICTURES}; is it whole, flat, large and sharp "
            "before these cameras?"
        )
    mirrored = [name for name, n in board.n_mirrored.items() if n and n == board.n_seen[name]]
    if board.both_sides:
        seen = [name for name, n in board.n_mirrored.items() if n]
        yield (
            f"{', '.join(seen)}: the mirror image of the board is seen, so both_sides = true: is the board printed on "
            "both sides, as if seen through? If it is not, switch off the mirroring of these cameras' pictures"
        )
    elif mirrored:
        yield f"{', '.join(mirrored)}: only the board's mirror image is seen: switch off the mirroring of the pictures"
    pattern = board.pattern
    if pattern.marker is None and (pattern.columns + pattern.rows) % 2 == 0:
        yield "this chessboard looks the same from both ends; a ChArUco board, or one more column, is safer"
    if len({one.n_frames for one in footage if one.n_frames}) > 1:
        yield "the views have different numbers of frames: `offsets` and `stop` make them fit"
    if unused:
        yield f"left out, because their names follow another pattern: {', '.join(path.name for path in unused)}"
    if len(footage) == 1:
        yield "one view: its lens is calibrated, but no rig; expected a recording of each camera"


def _board_text(name: str, path: str, footage: tuple[Footage, ...], board: FoundBoard, square_m: float | None) -> str:
    images = FRAME in path
    views = json.dumps([one.view for one in footage], ensure_ascii=False)
    most = max(one.n_frames for one in footage)
    stride = max(1, most // _N_USED)
    lines = [f"stride = {stride}                  # of {most} frames"] if stride > 1 else []
    lines += ["fps = 25.0                  # images need a value; any will do here"] if images else []
    return f"""\
#:schema ./{SCHEMA}
# Written by `bodytrack calibrate init`. `bodytrack calibrate chessboard THIS` calibrates.
{tomli_w.dumps({"name": name}).strip()}

[reading]
use = "{"images" if images else "video"}"
{tomli_w.dumps({"path": path}).strip()}   # {{view}} is the name that the camera gets
views = {views}
{"".join(line + chr(10) for line in lines)}
[calibration]
use = "chessboard"
{_board_lines(board, square_m)}
# lens = "fisheye"          # for lenses that see 100 degrees and more
# sigma_px = 0.2            # of an image coordinate; the report tells how noisy they are

# The world lies in the middle of what was seen, level as the cameras are held. A chessboard on the floor makes z = 0:
# [calibration.world]
# board = "floor/{{view}}.png"
# board_columns = 9         # inner corners
# board_rows = 6
# board_square_m = 0.03

# Recordings in which each camera sees the board alone, near and in all corners, tell its lens:
# [interiors]
# use = "video"
# path = "alone/{{view}}.mp4"
"""


def _board_lines(board: FoundBoard, square_m: float | None) -> str:
    pattern = board.pattern
    what = "inner corners in a row" if pattern.marker is None else "squares in a row"
    lines = [f"columns = {pattern.columns}                 # {what}", f"rows = {pattern.rows}"]
    if square_m is None:
        lines.append("# square_m = 0.0            # missing: the side of a square, metres; measure ten of them")
    else:
        lines.append(f"square_m = {square_m:g}            # as given; it is the scale of everything")
    if pattern.marker is not None:
        seen = f"the pictures show about {pattern.marker:.2f} of a square"
        if square_m is None:
            lines.append(f"# marker_m = 0.0            # missing: the side of a marker, metres; {seen}")
        else:
            lines.append(f"marker_m = {pattern.marker * square_m:.4g}          # {seen}: measure it")
        lines.append(f'dictionary = "{pattern.dictionary}"')
    for key, on in (("legacy", pattern.legacy), ("inverted", pattern.inverted), ("both_sides", board.both_sides)):
        lines += [f"{key} = true"] if on else []
    return "\n".join(lines)
