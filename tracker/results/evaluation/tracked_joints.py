"""One person's joints over time, as the tables of a result tell them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tracker.foundation.arrays import Array, Integers
from tracker.foundation.errors import SequenceError, nearest
from tracker.foundation.source_files import frame_in, number_in
from tracker.results.evaluation.joint_names import JointNames, names_of
from tracker.results.evaluation.tables import read_rows
from tracker.results.evaluation.time_correlation import Clocked

_AXES = ("x_m", "y_m", "z_m")


@dataclass(frozen=True)
class TrackedJoints:
    """One person's joints from the tables of a result."""

    person: str
    names: tuple[str, ...]
    frames: Integers
    """(T,) numbers of the frames."""

    statuses: tuple[str, ...]
    """(T,) of the frames; `ambiguous` where no frame is doubtful or lost but a joint may be elsewhere."""

    motion: Clocked
    """(T, J, 3) metres."""

    def chosen(self, names: Iterable[str]) -> Clocked:
        """The motion of some joints."""
        return Clocked(self.motion.times_s, self.motion.points[:, [self.names.index(name) for name in names]])


def tracked_joints(result: Path, person: str | None) -> tuple[TrackedJoints, JointNames]:
    """A person's joints from `joints.csv`, called as the body's model file calls them.

    Args:
        result: folder of a run, or of a smoothed one.
        person: whose; None where there is one only.

    Raises:
        SequenceError: the table is missing or damaged, nobody is called so, or there are several to choose from.
    """
    path = result / "joints.csv"
    if not path.is_file():
        raise SequenceError(f"{result}: no joints.csv there, expected the result folder of a run")
    rows = read_rows(path)
    for column in ("frame", "time_s", "person", "joint", *_AXES):
        if column not in rows[0]:
            raise SequenceError(f'{path}: no column "{column}"; {nearest(column, rows[0])}')
    persons = list(dict.fromkeys(row["person"] for row in rows))
    if person is not None and person not in persons:
        raise SequenceError(f'{path}: nobody is called "{person}"; {nearest(person, persons)}')
    if person is None and len(persons) > 1:
        raise SequenceError(
            f"{path}: {len(persons)} persons: say by --person who wore the markers: {', '.join(persons)}"
        )
    who = person or persons[0]
    names = names_of(result)[who]
    return _joints_of_table(path, [row for row in rows if row["person"] == who], names), names


def _joints_of_table(path: Path, rows: list[dict[str, str]], names: JointNames) -> TrackedJoints:
    times: dict[int, float] = {}
    found: dict[int, dict[str, Array]] = {}
    statuses: dict[int, str] = {}
    for row in rows:
        frame = frame_in(row, path, SequenceError)
        times[frame] = number_in(row, "time_s", path, SequenceError)
        known = all(row[axis] for axis in _AXES)
        point = [number_in(row, axis, path, SequenceError) for axis in _AXES] if known else [math.nan] * 3
        own = found.setdefault(frame, {})
        if row["joint"] in own:
            raise SequenceError(f"{path}: {row['joint']} of {row['person']} is there twice in frame {frame}")
        own[row["joint"]] = np.array(point)
        status = row.get("status", "")
        statuses[frame] = "ambiguous" if "ambiguous" in (status, statuses.get(frame)) else status
    frames = sorted(found)
    joints = [names.of(found[frame]) for frame in frames]
    columns = tuple(dict.fromkeys(name for points in joints for name in points))
    missing = np.full(3, np.nan)
    points = np.array([[frame.get(name, missing) for name in columns] for frame in joints])
    times_s = np.array([times[frame] for frame in frames])
    if len(frames) < 2 or not (np.diff(times_s) > 0).all():
        raise SequenceError(f"{path}: expected two frames or more of one person, each later than the one before")
    who = rows[0]["person"]
    marks = tuple(statuses[frame] for frame in frames)
    return TrackedJoints(who, columns, np.array(frames, dtype=np.int64), marks, Clocked(times_s, points))
