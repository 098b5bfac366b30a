"""Joint and pose tables of results, simulations and other people's references."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tracker.arrays import Array
from tracker.errors import SequenceError, nearest

_SIDES = {"l_": "left_", "r_": "right_", "L": "left_", "R": "right_"}
_WORDS = {"Head": "head_top", "Neck": "neck", "Hip": "pelvis", "HeadTop": "head_top", "C7": "neck"}
JOINTS = (
    "head_top",
    "neck",
    "pelvis",
    *(f"{s}_{j}" for s in ("left", "right") for j in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")),
)
"""Joint names compared, as in joints.csv."""


@dataclass(frozen=True)
class JointTable:
    """Joint centres of several persons."""

    persons: dict[str, dict[int, dict[str, Array]]]
    """Person -> frame -> joint -> (3,) metres."""


def joint_name(name: str) -> str:
    """Our name of a joint called otherwise: `l_elbow`, `RKnee`, `Head`."""
    if name in JOINTS:
        return name
    if name in _WORDS:
        return _WORDS[name]
    for prefix, side in _SIDES.items():
        rest = name[len(prefix) :]
        if name.startswith(prefix) and rest and (prefix.endswith("_") or rest[0].isupper()):
            return side + rest.lower()
    return name


def read_joints(path: Path) -> JointTable:
    """Reads a long table with the columns frame, joint, x, y, z (or x_m, ...) and perhaps person.

    Raises:
        SequenceError: the file cannot be read or lacks a column.
    """
    rows = read_rows(path)
    axes = ("x_m", "y_m", "z_m") if "x_m" in rows[0] else ("x", "y", "z")
    for column in ("frame", "joint", *axes):
        if column not in rows[0]:
            raise SequenceError(f'{path}: no column "{column}"; {nearest(column, rows[0])}')
    persons: dict[str, dict[int, dict[str, Array]]] = {}
    for row in rows:
        if any(row[axis] == "" for axis in axes):
            continue
        frames = persons.setdefault(row.get("person") or "1", {})
        point = np.array([float(row[axis]) for axis in axes])
        frames.setdefault(int(float(row["frame"])), {})[joint_name(row["joint"])] = point
    for frames in persons.values():
        for joints in frames.values():
            _add_pelvis(joints)
    return JointTable(persons)


def _add_pelvis(joints: dict[str, Array]) -> None:
    if "pelvis" not in joints and {"left_hip", "right_hip"} <= joints.keys():
        joints["pelvis"] = (joints["left_hip"] + joints["right_hip"]) / 2


def read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file.

    Raises:
        SequenceError: the file is missing, no text, or empty.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError) as error:
        raise SequenceError(f"{path}: cannot read the table: {error}") from error
    if not rows:
        raise SequenceError(f"{path}: the table is empty")
    return rows
