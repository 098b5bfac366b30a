"""CSV tables of keypoints: DeepLabCut's, and the analysis export of SLEAP."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from tracker.arrays import Array
from tracker.errors import SequenceError, shortened
from tracker.keypoint_names import plain_name
from tracker.keypoints import Detections
from tracker.source_files import cells_of, check_commas

_NUMBER = re.compile(r"\d+")
_MOST_FRAMES = 10**9
"""A year at 30 frames a second."""

_Rows = list[list[str]]


def read_table(path: Path) -> tuple[dict[int, Detections], bool]:
    """Keypoints of one view by frame; and whether these are numbers in names of images, not counted from 0 on.

    Args:
        path: a table of DeepLabCut (header rows `scorer`, perhaps `individuals`, `bodyparts`, `coords`) or of SLEAP
            (columns `track`, `frame_idx`, `nose.x`, `nose.y`, `nose.score`, ...).

    Raises:
        SequenceError: it cannot be read or is neither.
    """
    rows = cells_of(path, SequenceError)
    check_commas(rows[0] if rows else [], path, SequenceError)
    if rows and "frame_idx" in rows[0]:
        found, named = _sleap(rows, path), False
    elif rows and rows[0][0].strip().lower() == "scorer":
        found, named = _deeplabcut(rows, path), not rows[-1][0].strip().replace(".", "").isdecimal()
    else:
        raise SequenceError(
            f'{path}: neither a table of DeepLabCut (first cell "scorer") nor of SLEAP (a column "frame_idx")'
        )
    if not found:
        raise SequenceError(f"{path}: no frame in it")
    return found, named


def _deeplabcut(rows: _Rows, path: Path) -> dict[int, Detections]:
    """Three or four header rows; then the frame's number or image, and x, y, likelihood of every body part."""
    heads: dict[str, list[str]] = {}
    while rows and rows[0][0].strip().lower() in ("scorer", "individuals", "bodyparts", "coords"):
        heads[rows[0][0].strip().lower()] = rows[0][1:]
        rows = rows[1:]
    if not {"bodyparts", "coords"} <= heads.keys():
        raise SequenceError(f'{path}: no header rows "bodyparts" and "coords", as DeepLabCut writes them')
    n_columns = len(heads["bodyparts"])
    if n_columns == 0 or any(len(head) != n_columns for head in heads.values()):
        raise SequenceError(f"{path}: header rows of different lengths, expected a cell a column in each")
    people = heads.get("individuals", ["one"] * n_columns)
    columns = {
        (person, plain_name(part), axis.strip().lower()): k
        for k, (person, part, axis) in enumerate(zip(people, heads["bodyparts"], heads["coords"], strict=True))
    }
    names = tuple(dict.fromkeys(part for _, part, _ in columns))
    persons = tuple(dict.fromkeys(person for person, _, _ in columns))
    places = [
        [[columns.get((person, name, axis), -1) for axis in ("x", "y", "likelihood")] for name in names]
        for person in persons
    ]
    _check_places(np.max(places, axis=0).tolist(), names, path)  # some have body parts that others have not
    found: dict[int, Detections] = {}
    for n, row in enumerate(rows):
        where = f"the row of {shortened(row[0])}"
        if len(row) != n_columns + 1:
            raise SequenceError(f"{path}: {len(row)} cells in {where}, expected {n_columns + 1}")
        numbers = _NUMBER.findall(row[-1 - n_columns])
        values = np.array([*(_number(cell, path, where) for cell in row[1:]), np.nan])
        frame = _frame(float(numbers[-1]), path) if numbers else n
        if frame in found:
            raise SequenceError(f"{path}: a second row of frame {frame}, {where}: one a frame is expected")
        found[frame] = Detections(names, _present(values[np.array(places)]))
    return found


def _sleap(rows: _Rows, path: Path) -> dict[int, Detections]:
    """A row for each animal and frame: its columns are named `nose.x`, `nose.y`, `nose.score`."""
    head = rows[0]
    parts = [cell.rpartition(".")[0] for cell in head if cell.endswith(".x")]
    if not parts:
        raise SequenceError(f'{path}: no column like "nose.x", as SLEAP writes them')
    names = tuple(plain_name(part) for part in parts)
    columns = {cell: k for k, cell in enumerate(head)}
    places = [[columns.get(f"{part}.{axis}", -1) for axis in ("x", "y", "score")] for part in parts]
    _check_places(places, names, path)
    told, grouped = {k for place in places for k in place}, dict[int, list[Array]]()
    for n, row in enumerate(rows[1:], start=1):
        if len(row) != len(head):
            raise SequenceError(f"{path}: {len(row)} cells in row {n}, expected {len(head)}")
        # tracks have names
        known = [_number(cell, path, f"row {n}") if k in told else np.nan for k, cell in enumerate(row)]
        frame = _frame(_number(row[columns["frame_idx"]], path, f"row {n}"), path)
        grouped.setdefault(frame, []).append(np.array([*known, np.nan])[np.array(places)])
    return {frame: Detections(names, _present(np.array(found))) for frame, found in grouped.items()}


def _check_places(places: list[list[int]], names: tuple[str, ...], path: Path) -> None:
    """Refuses keypoints without a column of x or of y: they would be missing in every frame."""
    for name, place in zip(names, places, strict=True):
        for axis, column in zip("xy", place, strict=False):
            if column < 0:
                raise SequenceError(f'{path}: no column of the {axis} of "{name}", expected x and y of each keypoint')


def _frame(value: float, path: Path) -> int:
    if np.isnan(value):
        raise SequenceError(f"{path}: a row without frame_idx")
    if not 0 <= value <= _MOST_FRAMES or value != int(value):
        raise SequenceError(f"{path}: {value:g} as the number of a frame, expected a whole one")
    return int(value)


def _present(found: Array) -> Array:
    """(N, K, 3) with NaN throughout where a keypoint lacks a coordinate or confidence, 1 where none is told at all."""
    if np.isnan(found[..., 2]).all():
        found[..., 2] = np.where(np.isnan(found[..., 0]), np.nan, 1.0)
    found[~np.isfinite(found).all(axis=-1) | (found[..., 2] <= 0)] = np.nan
    return found


def _number(cell: str, path: Path, where: str) -> float:
    if not cell.strip():
        return np.nan
    try:
        return float(cell)
    except ValueError as error:
        raise SequenceError(f'{path}: "{shortened(cell)}" found in {where}, expected a number') from error
