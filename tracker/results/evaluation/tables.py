"""Joint and pose tables of results, simulations and other people's references."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tracker.foundation.arrays import Array
from tracker.foundation.errors import SequenceError, nearest
from tracker.foundation.source_files import frame_in, number_in, rows_of

_FARTHEST_M = 200.0
"""No joint is farther from the world's origin, as no camera is: what lies there is in other units."""

NOBODY = "1"
"""What the one person of a table that names nobody is called."""

Frames = dict[int, dict[str, Array]]
"""Frame -> joint -> (3,) metres."""


@dataclass(frozen=True)
class JointTable:
    """Joint centres of several persons."""

    persons: dict[str, Frames]
    """Joints are called as the table calls them; without frames: no joint of the person has a position."""


def read_joints(path: Path) -> JointTable:
    """Reads a long table with the columns frame, joint, x, y, z (or x_m, ...) and perhaps person.

    Raises:
        SequenceError: the file cannot be read, lacks a column, has something else than metres in it, or a joint of a
            person twice in a frame.
    """
    rows = read_rows(path)
    axes = ("x_m", "y_m", "z_m") if "x_m" in rows[0] else ("x", "y", "z")
    for column in ("frame", "joint", *axes):
        if column not in rows[0]:
            raise SequenceError(f'{path}: no column "{column}"; {nearest(column, rows[0])}')
    persons: dict[str, Frames] = {}
    for row in rows:
        person = row.get("person") or NOBODY
        frames = persons.setdefault(person, {})
        if any(row[axis] == "" for axis in axes):
            continue
        point = np.array([number_in(row, axis, path, SequenceError) for axis in axes])
        if np.abs(point).max() > _FARTHEST_M:
            raise SequenceError(
                f"{path}: {row['joint']} lies at {point.tolist()}, expected metres, at most {_FARTHEST_M:.0f}; "
                "divide millimetres by 1000"
            )
        frame = frame_in(row, path, SequenceError)
        joints = frames.setdefault(frame, {})
        if row["joint"] in joints:
            raise SequenceError(f"{path}: {row['joint']} of person {person} is there twice in frame {frame}")
        joints[row["joint"]] = point
    return JointTable(persons)


def read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file.

    Raises:
        SequenceError: the file is missing, no text, or empty.
    """
    return rows_of(path, SequenceError)
