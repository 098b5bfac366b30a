"""A draft of a calibration's configuration, made of the board that recordings show."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import tomli_w

from tracker.cameras.calibration import FoundBoard, found_board
from tracker.foundation.configuration.schema import SCHEMA
from tracker.foundation.errors import SequenceError
from tracker.foundation.progress import Progress, silent
from tracker.images.footage import FRAME, Footage, board_sources, header, pattern_of, spread_pictures

_N_PICTURES = 16
"""Of each view that are looked at."""

_N_USED = 400
"""Frames of a long recording that a calibration looks at: 100 to 200 positions of the board are enough."""

_FEWEST_SEEN = 3
"""Pictures of each view, of those looked at, in which the board should be."""


@dataclass(frozen=True)
class CalibrationDraft:
    """What was found, and the text made of it."""

    footage: tuple[Footage, ...]
    board: FoundBoard
    remarks: tuple[str, ...]
    """What is missing or does not fit, in one line each."""

    text: str
    """The commented configuration."""


def draft_calibration(
    folder: Path, target: Path, square_m: float | None = None, progress: Progress = silent
) -> CalibrationDraft:
    """Finds the board in recordings, and writes down a configuration of them.

    Args:
        folder: of the videos or numbered images, one a view.
        target: where the configuration will lie; paths in it start there.
        square_m: side of the board's squares, metres, which no picture tells; None leaves it to be written.
        progress: told how far it is.

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
    remarks = (*_remarks(board, footage, sorted(set(there) - set(views.values()))), *_missing(square_m))
    start = target.resolve().parent
    path = Path(os.path.relpath(pattern.absolute(), start)).as_posix()
    text = _text(folder.resolve().name, path, footage, board, square_m)
    return CalibrationDraft(footage, board, remarks, text)


def _missing(square_m: float | None) -> Iterator[str]:
    if square_m is None:
        yield "no picture tells how long a square is: measure ten of them, and set square_m and marker_m"


def _remarks(board: FoundBoard, footage: tuple[Footage, ...], unused: list[Path]) -> Iterator[str]:
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
            "both sides, as if seen through? If it is not, switch off what mirrors these cameras' pictures"
        )
    elif mirrored:
        yield f"{', '.join(mirrored)}: only the mirror image of the board is seen: switch off what mirrors the pictures"
    pattern = board.pattern
    if pattern.marker is None and (pattern.columns + pattern.rows) % 2 == 0:
        yield "this chessboard looks the same from both ends; a ChArUco board, or one more column, is safer"
    if len({one.n_frames for one in footage if one.n_frames}) > 1:
        yield "the views have different numbers of frames: `offsets` and `stop` make them fit"
    if unused:
        yield f"left out, for their names follow another pattern: {', '.join(path.name for path in unused)}"
    if len(footage) == 1:
        yield "one view: its lens is calibrated, but no rig; expected a recording of each camera"


def _text(name: str, path: str, footage: tuple[Footage, ...], board: FoundBoard, square_m: float | None) -> str:
    images = FRAME in path
    views = json.dumps([one.view for one in footage], ensure_ascii=False)
    most = max(one.n_frames for one in footage)
    stride = max(1, most // _N_USED)
    lines = [f"stride = {stride}                  # of {most} frames"] if stride > 1 else []
    lines += ["fps = 25.0                  # images need some; it does not matter here"] if images else []
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
        lines.append(f"square_m = {square_m:g}            # as told; it is the scale of everything")
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
