"""Start poses from a file."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from tracker.arrays import Array
from tracker.body import BodyModel
from tracker.components import FilePath, component
from tracker.errors import InitializationError, nearest
from tracker.frame import Frame
from tracker.initialization import Stages
from tracker.scene import Person, Scene
from tracker.start import Start


@component
class GivenInitialization:
    """Takes the start poses from a CSV in the layout of poses.csv, so that any earlier result can start a run."""

    poses: FilePath
    """CSV with the columns `frame`, `person` and every parameter with its unit (`torso_x_m`, ...)."""

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        """The row of each person with the frame's number, or the nearest earlier one, or the first."""
        rows = _rows(self.poses)
        return Start(tuple(self._pose(rows, person, frame.index) for person in scene.persons))

    def _pose(self, rows: list[dict[str, str]], person: Person, index: int) -> Array:
        mine = [row for row in rows if row.get("person") == person.name and row.get("status") != "lost"]
        if not mine:
            names = {row.get("person") or "" for row in rows}
            raise InitializationError(f'{self.poses}: no pose of person "{person.name}"; {nearest(person.name, names)}')
        earlier = [row for row in mine if _number(row, "frame", self.poses) <= index]
        return _parameters(earlier[-1] if earlier else mine[0], person.body, self.poses)


def _rows(path: Path) -> list[dict[str, str]]:
    try:
        with path.open(newline="") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError) as error:
        raise InitializationError(f"{path}: cannot read the start poses: {error}") from error
    if not rows:
        raise InitializationError(f"{path}: no start pose in it, expected the layout of poses.csv")
    return rows


def _parameters(row: dict[str, str], body: BodyModel, path: Path) -> Array:
    values = []
    for parameter in body.parameters:
        if parameter.column not in row:
            raise InitializationError(
                f'{path}: no column "{parameter.column}" of model "{body.name}"; {nearest(parameter.column, row)}'
            )
        value = _number(row, parameter.column, path)
        values.append(math.radians(value) if parameter.rotates else value)
    pose = np.array(values)
    outside = (pose < body.limits[:, 0] - 1e-6) | (pose > body.limits[:, 1] + 1e-6)
    if outside.any():
        name = body.names[int(np.flatnonzero(outside)[0])]
        raise InitializationError(f'{path}: "{name}" is outside the joint limits of model "{body.name}"')
    return pose


def _number(row: dict[str, str], column: str, path: Path) -> float:
    try:
        return float(row[column])
    except (KeyError, TypeError, ValueError) as error:
        raise InitializationError(f'{path}: column "{column}": not a number: {row.get(column)!r}') from error
