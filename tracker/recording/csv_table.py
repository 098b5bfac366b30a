"""Pose parameters, their standard deviations and joint centres as CSV tables."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TextIO

import numpy as np
import pydantic

from tracker.arrays import Array
from tracker.components import component
from tracker.estimate import Estimate, Status
from tracker.recording import RunContext
from tracker.scene import Person
from tracker.trajectory import Step

_JOINT_COLUMNS = ("frame", "time_s", "person", "joint", "x_m", "y_m", "z_m", "status")
_POSE_COLUMNS = ("frame", "time_s", "person", "status", "ambiguous", "distance_px")


@component
class CsvTable:
    """`poses.csv`, `sigmas.csv` and `joints.csv`; in lost frames the values are empty."""

    decimals: int = pydantic.Field(default=5, ge=0, le=15)
    """Digits after the point: 0.01 mm and 0.00001 degrees."""

    def begin(self, run: RunContext) -> CsvRecorder:
        """Opens the three tables."""
        return CsvRecorder(run, self.decimals)


class CsvRecorder:
    """The open tables."""

    def __init__(self, run: RunContext, decimals: int) -> None:
        self._decimals = decimals
        self._columns = parameter_columns(run.scene.persons)
        self._stack = ExitStack()
        self._written: list[Path] = []
        self._poses = self._open(run, "poses.csv", (*_POSE_COLUMNS, *self._columns))
        self._sigmas = self._open(run, "sigmas.csv", (*_POSE_COLUMNS, *self._columns))
        self._joints = self._open(run, "joints.csv", _JOINT_COLUMNS)

    def _open(self, run: RunContext, name: str, columns: Sequence[str]) -> TextIO:
        self._written.append(run.folder / name)
        file = self._stack.enter_context(self._written[-1].open("w", newline="", encoding="utf-8"))
        csv.writer(file).writerow(columns)
        file.flush()
        return file

    def write(self, step: Step) -> None:
        """Adds the rows of one frame."""
        for person, estimate in zip(step.scene.persons, step.estimates, strict=True):
            start = [step.frame.index, f"{step.frame.time_s:.6f}", person.name]
            head = [*start, str(estimate.verdict), " ".join(estimate.ambiguous), f"{estimate.distance_px:.4f}"]
            sigma = np.sqrt(np.maximum(np.diag(estimate.covariance), 0.0))
            csv.writer(self._poses).writerow([*head, *self._values(person, estimate, estimate.q)])
            csv.writer(self._sigmas).writerow([*head, *self._values(person, estimate, sigma)])
            points = person.body.landmarks_in_world(estimate.q)
            statuses = joint_statuses(person, estimate)
            for mark in person.body.reported:
                where = ["", "", ""] if estimate.lost else [self._text(value) for value in points[mark]]
                csv.writer(self._joints).writerow([*start, person.body.landmark_names[mark], *where, statuses[mark]])
        for file in (self._poses, self._sigmas, self._joints):
            file.flush()

    def _values(self, person: Person, estimate: Estimate, values: Array) -> list[str]:
        shown = dict(zip((p.column for p in person.body.parameters), in_table_units(person, values), strict=True))
        return ["" if estimate.lost or column not in shown else self._text(shown[column]) for column in self._columns]

    def _text(self, value: float) -> str:
        return f"{value:.{self._decimals}f}" if np.isfinite(value) else ""

    def finish(self) -> tuple[Path, ...]:
        """Closes the tables."""
        self._stack.close()
        return tuple(self._written)


def joint_statuses(person: Person, estimate: Estimate) -> list[str]:
    """What is known of each landmark: the frame's verdict, `ambiguous` on a limb that may be elsewhere."""
    statuses = np.full(len(person.body.landmarks), str(estimate.verdict), dtype=object)
    if estimate.verdict in (Status.TRACKED, Status.BOOTSTRAPPED, Status.RECOVERED):
        for group in estimate.ambiguous:
            statuses[person.body.landmarks_of(group)] = "ambiguous"
    return statuses.tolist()


def parameter_columns(persons: Sequence[Person]) -> tuple[str, ...]:
    """Column names of all persons' parameters, each once."""
    columns = [parameter.column for person in persons for parameter in person.body.parameters]
    return tuple(dict.fromkeys(columns))


def in_table_units(person: Person, values: Array) -> Array:
    """Pose parameters (..., dof) in the units of the tables: degrees and metres."""
    shown: Array = np.where(person.body.rotates, np.degrees(values), values)
    return shown
