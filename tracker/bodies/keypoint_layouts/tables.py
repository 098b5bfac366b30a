"""CSV tables of keypoints: DeepLabCut's, SLEAP's and its library's, and others with a column a coordinate."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from tracker.bodies.keypoint_layouts.orders import last_number, number, with_gaps
from tracker.bodies.keypoints import plain_name
from tracker.foundation.arrays import Array, Integers
from tracker.foundation.errors import SequenceError, shortened
from tracker.foundation.source_files import cells_of, check_commas

_MOST_FRAMES = 10**9
"""A year at 30 frames a second."""

_HEADS = ("scorer", "individuals", "bodyparts", "coords")
_FRAME = ("frame_idx", "frame", "frame_id", "frame_number")
_VIDEO = ("video", "video_path")
_COLUMN = re.compile(r"(.+)[._ ](x|y|score|likelihood|confidence|visibility)", re.IGNORECASE)
"""`nose.x` of SLEAP, `NOSE_x` and `nose_visibility` from MediaPipe's users."""

_AXES = ("x", "y", "confidence")

_Rows = list[list[str]]
_Key = tuple[str, str, str]
"""Person, keypoint and axis."""


def read_table(path: Path) -> tuple[tuple[str, ...], dict[int, Array], bool]:
    """Names of keypoints; (N, K, 3) by frame; whether frames are numbers in names of images, not counted from 0 on.

    Args:
        path: a table of DeepLabCut (header rows `scorer`, perhaps `individuals`, `bodyparts`, `coords`), or one with a
            column of the frame (`frame_idx` or `frame`) and `nose.x`, `nose.y`, `nose.score`, ...: a row a person as
            SLEAP writes, a row a frame or a row a keypoint (`node`, `x`, `y`) as its library sleap-io does as well.

    Raises:
        SequenceError: it cannot be read or is neither.
    """
    rows = cells_of(path, SequenceError)
    check_commas(rows[0] if rows else [], path, SequenceError)
    head = [cell.strip().lower() for cell in rows[0]] if rows else [""]
    named = False
    if head[0] == "scorer":
        names, found, named = _deeplabcut(rows, path)
    elif {"node", "x", "y"} <= set(head) and _frame_column(head) is not None:
        names, found = _long(rows, path)
    elif _frame_column(head) is not None:
        names, found = _wide(rows, path)
    else:
        raise SequenceError(
            f'{path}: neither a table of DeepLabCut (first cell "scorer") nor of SLEAP (a column "frame_idx"), '
            'nor another with the columns "frame", "nose_x", "nose_y", ...'
        )
    if not found:
        raise SequenceError(f"{path}: no frame in it")
    return names, _present(found), named


def _deeplabcut(rows: _Rows, path: Path) -> tuple[tuple[str, ...], dict[int, list[Array]], bool]:
    """Three or four header rows; then the frame's number or image, and x, y, likelihood of every body part."""
    heads: dict[str, list[str]] = {}
    while rows and rows[0][0].strip().lower() in _HEADS:
        heads[rows[0][0].strip().lower()] = rows[0]
        rows = rows[1:]
    if not {"bodyparts", "coords"} <= heads.keys():
        raise SequenceError(f'{path}: no header rows "bodyparts" and "coords", as DeepLabCut writes them')
    # of labelled images three cells a row tell which
    n_before = next((k for k, cell in enumerate(heads["bodyparts"]) if k and cell.strip()), 1)
    n_columns = len(heads["bodyparts"])
    if n_columns == n_before or any(len(head) != n_columns for head in heads.values()):
        raise SequenceError(f"{path}: header rows of different lengths, expected a cell a column in each")
    people = heads.get("individuals", ["one"] * n_columns)
    keys = zip(people[n_before:], heads["bodyparts"][n_before:], heads["coords"][n_before:], strict=True)
    columns = {
        k: (person, plain_name(part), "confidence" if axis.strip().lower() == "likelihood" else axis.strip().lower())
        for k, (person, part, axis) in enumerate(keys, start=n_before)
    }
    names, places = _places(columns, path)
    found: dict[int, list[Array]] = {}
    for n, row in enumerate(rows):
        where = f"the row of {shortened(row[0])}"
        known = _row(row, columns, n_columns, path, where)
        told = last_number(row[n_before - 1])
        frame = n if told is None else _frame(told, path)
        if frame in found:
            raise SequenceError(f"{path}: a second row of frame {frame}, {where}: one a frame is expected")
        found[frame] = [known[places]]
    named = bool(rows) and not rows[-1][n_before - 1].strip().replace(".", "").isdecimal()
    return names, found, named


def _wide(rows: _Rows, path: Path) -> tuple[tuple[str, ...], dict[int, list[Array]]]:
    """A row for each person and frame, or for each frame: its columns are named `nose.x`, or `inst0.nose.x`."""
    head = [cell.strip() for cell in rows[0]]
    persons = tuple(cell.removesuffix("track") for cell in head if cell.endswith(".track"))
    columns = {}
    for k, cell in enumerate(head):
        person = next((one for one in persons if cell.startswith(one)), "")
        if match := _COLUMN.fullmatch(cell.removeprefix(person)):
            axis = match[2].lower()
            columns[k] = (person, plain_name(match[1]), axis if axis in "xy" else "confidence")
    with_place = {part for _, part, axis in columns.values() if axis == "x"}
    if not with_place:
        raise SequenceError(f'{path}: no column like "nose.x", as SLEAP writes them')
    # instance.score is of no keypoint
    names, places = _places({k: key for k, key in columns.items() if key[1] in with_place}, path)
    _check_video(rows, path)
    found: dict[int, list[Array]] = {}
    for n, row in enumerate(rows[1:], start=1):
        known = _row(row, columns, len(head), path, f"row {n}")
        found.setdefault(_frame_of(row, rows[0], path, n), []).append(known[places])
    return names, found


def _long(rows: _Rows, path: Path) -> tuple[tuple[str, ...], dict[int, list[Array]]]:
    """A row for each keypoint, person and frame; a keypoint that comes again in a frame is of another person."""
    head = [cell.strip().lower() for cell in rows[0]]
    _check_video(rows, path)
    score = next((head.index(one) for one in ("score", "likelihood", "confidence") if one in head), None)
    axes = [head.index("x"), head.index("y"), *([] if score is None else [score])]
    names = tuple(dict.fromkeys(plain_name(row[head.index("node")]) for row in rows[1:] if len(row) == len(head)))
    persons: dict[int, list[dict[str, Array]]] = {}
    for n, row in enumerate(rows[1:], start=1):
        values = _row(row, axes, len(head), path, f"row {n}")[[*axes, *([-1] if score is None else [])]]
        seen = persons.setdefault(_frame_of(row, rows[0], path, n), [{}])
        if (name := plain_name(row[head.index("node")])) in seen[-1]:
            seen.append({})
        seen[-1][name] = values
    gone = np.full(3, np.nan)
    found = {
        frame: [np.array([[one.get(name, gone) for name in names] for one in seen])] for frame, seen in persons.items()
    }
    return names, found


def _places(columns: dict[int, _Key], path: Path) -> tuple[tuple[str, ...], Integers]:
    """Names of the keypoints; (P, K, 3) the columns of each person's x, y and confidence, -1 for none.

    Refuses columns that repeat, and keypoints without one of x or of y: they would be missing in every frame.
    """
    found: dict[_Key, int] = {}
    for k, key in columns.items():
        if found.setdefault(key, k) != k:
            raise SequenceError(f'{path}: two columns are the {key[2]} of "{key[1]}", expected each keypoint once')
    names = tuple(dict.fromkeys(part for _, part, _ in found))
    persons = dict.fromkeys(person for person, _, _ in found)
    places = np.array([[[found.get((one, name, axis), -1) for axis in _AXES] for name in names] for one in persons])
    # some have body parts that others have not
    for name, place in zip(names, np.max(places, axis=0), strict=True):
        for axis, column in zip("xy", place, strict=False):
            if column < 0:
                raise SequenceError(f'{path}: no column of the {axis} of "{name}", expected x and y of each keypoint')
    return names, places


def _row(row: list[str], columns: Iterable[int], n_columns: int, path: Path, where: str) -> Array:
    """(n_columns + 1,) the numbers of a row, NaN for other cells and for the last, which is none."""
    if len(row) != n_columns:
        raise SequenceError(f"{path}: {len(row)} cells in {where}, expected {n_columns}")
    known = np.full(n_columns + 1, np.nan)
    for k in columns:
        try:
            known[k] = number(row[k])
        except ValueError as error:
            raise SequenceError(f'{path}: "{shortened(row[k])}" found in {where}, expected a number') from error
    return known


def _frame_column(head: list[str]) -> int | None:
    return next((head.index(name) for name in _FRAME if name in head), None)


def _frame_of(row: list[str], head: list[str], path: Path, n: int) -> int:
    """The number of a row's frame."""
    cell = row[_frame_column([one.strip().lower() for one in head]) or 0]
    try:
        return _frame(number(cell), path)
    except ValueError as error:
        raise SequenceError(f'{path}: "{shortened(cell)}" found in row {n}, expected a number') from error


def _frame(value: float, path: Path) -> int:
    if np.isnan(value):
        raise SequenceError(f"{path}: a row without frame_idx")
    if not 0 <= value <= _MOST_FRAMES or value != int(value):
        raise SequenceError(f"{path}: {value:g} as the number of a frame, expected a whole one")
    return int(value)


def _check_video(rows: _Rows, path: Path) -> None:
    """Refuses rows of several videos: of several views, or of others beside this one."""
    head = [cell.strip().lower() for cell in rows[0]]
    column = next((head.index(name) for name in _VIDEO if name in head), None)
    videos = dict.fromkeys(row[column] for row in rows[1:] if len(row) == len(head)) if column is not None else {}
    if len(videos) > 1:
        told = ", ".join(shortened(video) for video in list(videos)[:3])
        raise SequenceError(f"{path}: rows of {len(videos)} videos ({told}), expected those of one view")


def _present(frames: dict[int, list[Array]]) -> dict[int, Array]:
    """(N, K, 3) a frame, with NaN throughout where a keypoint was not found.

    Confidence is 1 where none is told of a person; some programs write 0 there, throughout the table.
    """
    raw = {frame: np.concatenate(found) for frame, found in frames.items()}
    none_told = not any((found[..., 2] > 0).any() for found in raw.values())
    for found in raw.values():
        silent = np.isnan(found[..., 2]).all(axis=1) | none_told
        found[silent, :, 2] = 1.0
    return {frame: with_gaps(found) for frame, found in raw.items()}
