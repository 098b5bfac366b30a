"""Pose parameters, their standard deviations, joint centres and doubts as CSV tables."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pydantic

from tracker.bodies.scene import Person
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.foundation.files import GrowingFile, csv_lines
from tracker.results.recording import RunContext
from tracker.tracking.doubt import Doubt
from tracker.tracking.estimate import Estimate, Status
from tracker.tracking.limb_probabilities import limb_probabilities
from tracker.tracking.trajectory import Step

_JOINT_COLUMNS = ("frame", "time_s", "person", "joint", "x_m", "y_m", "z_m", "status", "sigma_m")
_DOUBT_COLUMNS = ("frame", "time_s", "person", "limb", "because", "value", "limit")
_LIMB_COLUMNS = ("frame", "time_s", "person", "limb", "probability")
_POSE_COLUMNS = ("frame", "time_s", "person", "status", "ambiguous", "distance_px")


@component
class CsvTable:
    """`poses.csv`, `sigmas.csv` and `joints.csv`, with empty values in lost frames; `doubts.csv`, a row a reason.

    `limbs.csv` has a row a limb: the probability that its joints are within 150 mm, see
    `tracker.tracking.limb_probabilities`.
    """

    decimals: int = pydantic.Field(default=5, ge=0, le=15)
    """Digits after the point: 0.01 mm and 0.00001 degrees."""

    def begin(self, run: RunContext) -> CsvRecorder:
        """Opens the tables."""
        return CsvRecorder(run, self.decimals)


class CsvRecorder:
    """The open tables."""

    def __init__(self, run: RunContext, decimals: int) -> None:
        self._run, self._decimals = run, decimals
        self._columns = parameter_columns(run.scene.persons)
        self._poses = self._open("poses.csv", (*_POSE_COLUMNS, *self._columns))
        self._sigmas = self._open("sigmas.csv", (*_POSE_COLUMNS, *self._columns))
        self._joints = self._open("joints.csv", _JOINT_COLUMNS)
        self._doubts = self._open("doubts.csv", _DOUBT_COLUMNS)
        self._limbs = self._open("limbs.csv", _LIMB_COLUMNS)

    def _open(self, name: str, columns: Sequence[str]) -> GrowingFile:
        file = GrowingFile(self._run.folder / name, waits=bool(self._run.resumed))
        file.add(csv_lines([columns]))
        return file

    def write(self, step: Step) -> None:
        """Adds the rows of one frame."""
        poses, sigmas, joints, doubts, limbs = [], [], [], [], []
        for person, estimate in zip(step.scene.persons, step.estimates, strict=True):
            start = [step.frame.index, f"{step.frame.time_s:.6f}", person.name]
            distance = "" if estimate.lost else f"{estimate.distance_px:.4f}"
            head = [*start, str(estimate.verdict), " ".join(estimate.ambiguous), distance]
            sigma = np.sqrt(np.maximum(np.diag(estimate.covariance), 0.0))
            poses.append([*head, *self._values(person, estimate, estimate.q)])
            sigmas.append([*head, *self._values(person, estimate, sigma)])
            points = person.body.landmarks_in_world(estimate.q)
            statuses, sigmas_m = joint_statuses(person, estimate), joint_sigmas(person, estimate)
            for mark in person.body.reported:
                where = ["", "", ""] if estimate.lost else [self._text(value) for value in points[mark]]
                spread = "" if estimate.lost else self._text(sigmas_m[mark])
                joints.append([*start, person.body.landmark_names[mark], *where, statuses[mark], spread])
            doubts += [[*start, *self._reason(doubt)] for doubt in estimate.doubts]
            right = {} if estimate.lost else limb_probabilities(person.body, estimate)
            limbs += [[*start, limb, f"{right[limb]:.3f}" if right else ""] for limb in person.body.limbs]
        for file, rows in zip(self._files, (poses, sigmas, joints, doubts, limbs), strict=True):
            file.add(csv_lines(rows))
            if step.frame.index not in self._run.resumed:
                file.take_place()

    @property
    def _files(self) -> tuple[GrowingFile, ...]:
        return self._poses, self._sigmas, self._joints, self._doubts, self._limbs

    def _reason(self, doubt: Doubt) -> list[str]:
        numbers = ("" if number is None else self._text(number) for number in (doubt.value, doubt.limit))
        return [doubt.limb, str(doubt.because), *numbers]

    def _values(self, person: Person, estimate: Estimate, values: Array) -> list[str]:
        shown = dict(zip((p.column for p in person.body.parameters), in_table_units(person, values), strict=True))
        return ["" if estimate.lost or column not in shown else self._text(shown[column]) for column in self._columns]

    def _text(self, value: float) -> str:
        return f"{value:.{self._decimals}f}" if np.isfinite(value) else ""

    def finish(self) -> tuple[Path, ...]:
        """Names the tables."""
        return tuple(file.take_place() for file in self._files)


def joint_statuses(person: Person, estimate: Estimate) -> list[str]:
    """State of each landmark: the frame's verdict, `ambiguous` on an ambiguous limb."""
    statuses = np.full(len(person.body.landmarks), str(estimate.verdict), dtype=object)
    if estimate.verdict in (Status.TRACKED, Status.BOOTSTRAPPED, Status.RECOVERED):
        for group in estimate.ambiguous:
            statuses[person.body.landmarks_of(group)] = "ambiguous"
    return statuses.tolist()


def joint_sigmas(person: Person, estimate: Estimate) -> Array:
    """(L,) standard deviation of each landmark, root of the summed variances of x, y, z, metres; NaN where unknown."""
    if estimate.joint_sigmas_m is not None:
        return estimate.joint_sigmas_m
    return person.body.landmark_sigmas(estimate.q, estimate.covariance)


def parameter_columns(persons: Sequence[Person]) -> tuple[str, ...]:
    """Column names of all persons' parameters, each once."""
    columns = [parameter.column for person in persons for parameter in person.body.parameters]
    return tuple(dict.fromkeys(columns))


def in_table_units(person: Person, values: Array) -> Array:
    """Pose parameters (..., dof) in the units of the tables: degrees and metres."""
    shown: Array = np.where(person.body.rotates, np.degrees(values), values)
    return shown
