"""Joints over time from tables of results and references: names, positions, uncertainties."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pydantic

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.bodies.body.sections import Joints
from tracker.bodies.segments import Mirror
from tracker.foundation.arrays import Array, Integers
from tracker.foundation.errors import SequenceError, nearest, shortened
from tracker.foundation.resources import model_path
from tracker.foundation.source_files import frame_in, json_of, number_in, one_line, rows_of
from tracker.results.evaluation.time_correlation import Clocked

_FARTHEST_M = 200.0
"""Largest distance of a joint from the world's origin, as of a camera: beyond, it is in other units."""

NOBODY = "1"
"""Name of the person in a table without names."""

Frames = dict[int, dict[str, Array]]
"""Frame -> joint -> (3,) metres."""


@dataclass(frozen=True)
class JointTable:
    """Joint centres of several persons."""

    persons: dict[str, Frames]
    """Joints have the table's names; without frames no joint of the person has a position."""


def read_joints(path: Path) -> JointTable:
    """Reads a long table with the columns frame, joint, x, y, z (or x_m, ...) and perhaps person.

    Raises:
        SequenceError: the file cannot be read, lacks a column, has values other than metres, or a joint of a person
            twice in a frame.
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
        SequenceError: the file is missing, not text, or empty.
    """
    return rows_of(path, SequenceError)


# The body's model file says which joints of a result are compared, and their names in a reference.


@dataclass(frozen=True)
class JointNames:
    """The compared joints of one body."""

    joints: Joints
    mirror: Mirror

    def ours(self, name: str) -> str:
        """Our name of a joint that a reference calls `l_elbow`, `RKnee` or `Head`; any other name stays."""
        for own, others in self.joints.aliases.items():
            if name in others:
                return own
        for side in self.mirror.sides:
            known = set(self.joints.evaluated)
            if name[:2].lower() == f"{side[0].lower()}_" and (own := f"{side}_{name[2:].lower()}") in known:
                return own
            if name[:1] == side[0].upper() and name[1:2].isupper() and (own := f"{side}_{name[1:].lower()}") in known:
                return own
        return name

    def of(self, found: dict[str, Array]) -> dict[str, Array]:
        """Points (3,) of one frame by our names; missing ones are midway between two others.

        Raises:
            SequenceError: two names mean the same joint.
        """
        named: dict[str, Array] = {}
        for name, point in found.items():
            if named.setdefault(own := self.ours(name), point) is not point:
                both = ", ".join(shortened(other) for other in found if self.ours(other) == own)
                raise SequenceError(f"{both} all mean the joint {own}, expected one of them: leave the others out")
        for name, (one, other) in self.joints.middles.items():
            if name not in named and one in named and other in named:
                named[name] = (named[one] + named[other]) / 2
        return named


def names_of(result: Path) -> dict[str, JointNames]:
    """Person -> the joints to compare, from the run.json of a result folder.

    Other persons have the joints of gavrila22: tables of other programs are compared as well.

    Raises:
        SequenceError: run.json is damaged.
    """
    body = load_body(model_path("gavrila22"))
    names = defaultdict(lambda: JointNames(body.joints, body.mirror))
    path = result / "run.json"
    if path.is_file():
        try:
            entries: list[dict[str, Any]] = json_of(path, SequenceError).get("persons", [])
            for entry in (entry for entry in entries if "joints" in entry):
                one, other = entry["sides"]
                names[entry["name"]] = JointNames(Joints.model_validate(entry["joints"]), Mirror((one, other)))
        except (ValueError, KeyError, AttributeError, TypeError, pydantic.ValidationError) as error:
            raise SequenceError(f"{path}: damaged, expected the file of a run: {one_line(error)}") from error
    return names


# One person's joints over time, as the tables of a result tell them.

_AXES = ("x_m", "y_m", "z_m")


@dataclass(frozen=True)
class TrackedJoints:
    """One person's joints from the tables of a result."""

    person: str
    names: tuple[str, ...]
    frames: Integers
    """(T,) numbers of the frames."""

    statuses: tuple[str, ...]
    """(T,) of the frames; `ambiguous` if the frame is neither doubtful nor lost and a joint is ambiguous."""

    motion: Clocked
    """(T, J, 3) metres."""

    def chosen(self, names: Iterable[str]) -> Clocked:
        """The motion of some joints."""
        return Clocked(self.motion.times_s, self.motion.points[:, [self.names.index(name) for name in names]])


def tracked_joints(result: Path, person: str | None) -> tuple[TrackedJoints, JointNames]:
    """A person's joints from `joints.csv`, with the names in the body's model file.

    Args:
        result: folder of a run, or of a smoothed one.
        person: name; None if there is only one.

    Raises:
        SequenceError: the table is missing or damaged, no person has the name, or there are several to choose from.
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
        raise SequenceError(f'{path}: no person is called "{person}"; {nearest(person, persons)}')
    if person is None and len(persons) > 1:
        raise SequenceError(
            f"{path}: {len(persons)} persons: choose by --person who wore the markers: {', '.join(persons)}"
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


# The standard deviations that a run tells of joints and hinges, to be held against its errors.

_SAME_M = 0.005
"""A parameter whose axis passes a hinge's landmark this closely belongs to that joint."""


def joint_sigmas_mm(result: Path, person: str) -> dict[str, float]:
    """Joint -> RMS of its standard deviation in the tables, millimetres; empty if they have none.

    Args:
        result: folder of a run, or of another program's tables.
        person: of the run.
    """
    told: dict[str, list[float]] = {}
    for row in _rows(result / "joints.csv", person):
        if row.get("sigma_m"):
            sigma_m = number_in(row, "sigma_m", result / "joints.csv", SequenceError)
            told.setdefault(row["joint"], []).append(1000 * sigma_m)
    return {joint: _rms(np.array(values)) for joint, values in told.items()}


def hinge_sigmas_deg(result: Path, person: str, joints: Joints) -> dict[str, float]:
    """Hinge -> RMS of the standard deviation of its angle, degrees; empty if the folder has none.

    Args:
        result: folder of a run.
        person: of the run.
        joints: names the landmarks that are hinges.
    """
    path, model = result / "sigmas.csv", result / "models" / f"{person}.toml"
    if not (path.is_file() and model.is_file()):
        return {}
    body, rows = load_body(model), _rows(path, person)
    found = {}
    for hinge, chain in joints.chains().items():
        column = _column(body, chain)
        values = [number_in(row, column, path, SequenceError) for row in rows if column and row.get(column)]
        if values:
            found[hinge] = _rms(np.array(values))
    return found


def _column(body: BodyModel, chain: tuple[str, str, str]) -> str:
    """Name of the parameter that bends a chain of three landmarks; empty if no single one does."""
    if not set(chain) <= set(body.landmark_names):
        return ""
    before, hinge, behind = (body.landmarks[body.landmark_names.index(name)] for name in chain)
    bending = [
        one.column
        for k, one in enumerate(body.parameters)
        if one.rotates
        and np.linalg.norm(one.point - hinge.point) < _SAME_M
        and body.moves[k, behind.parameter]
        and not body.moves[k, before.parameter]
    ]
    return bending[0] if len(bending) == 1 else ""


def _rows(path: Path, person: str) -> list[dict[str, str]]:
    return [row for row in read_rows(path) if (row.get("person") or NOBODY) == person]


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
