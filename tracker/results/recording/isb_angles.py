"""Joint angles in the standard of the International Society of Biomechanics, beside those of the model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pydantic

from tracker.bodies.scene import Person
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import ConfigError
from tracker.foundation.files import GrowingFile, csv_lines
from tracker.results.recording import RunContext
from tracker.results.recording._anatomical import AnatomicalJoint, angles_of, joints_of, leaning_limb
from tracker.tracking.estimate import Estimate
from tracker.tracking.trajectory import Step

_FIRST = ("frame", "time_s", "status", "ambiguous")


@component
class IsbAngles:
    """`NAME_isb.csv` for each person: a row a frame with `left_hip_flexion_deg`, ...; see docs/formats.md.

    The standard deviations follow behind all angles, as `left_hip_flexion_sigma_deg`. In lost frames
    the values are empty, as are plane and axial rotation of an arm that hangs straight down.
    """

    decimals: int = pydantic.Field(default=3, ge=0, le=15)
    """Digits after the point."""

    def begin(self, run: RunContext) -> IsbRecorder:
        """Opens the tables.

        Raises:
            ConfigError: a body has no joints of a person, or its limbs do not hang down in the reference pose.
        """
        return IsbRecorder(run, self.decimals)


class IsbRecorder:
    """The open tables, one a person."""

    def __init__(self, run: RunContext, decimals: int) -> None:
        self._run, self._decimals = run, decimals
        self._joints = [_checked(person) for person in run.scene.persons]
        self._files = [self._opened(*pair) for pair in zip(run.scene.persons, self._joints, strict=True)]

    def _opened(self, person: Person, joints: list[AnatomicalJoint]) -> GrowingFile:
        file = GrowingFile(self._run.folder / f"{person.name}_isb.csv", waits=bool(self._run.resumed))
        names = [f"{joint.name}_{angle}" for joint in joints for angle in joint.angles]
        columns = [f"{name}_{what}" for what in ("deg", "sigma_deg") for name in names]
        file.add(csv_lines([[*_FIRST, *columns]]))
        return file

    def write(self, step: Step) -> None:
        """Adds a row to each table."""
        rows = zip(self._files, self._joints, step.scene.persons, step.estimates, strict=True)
        for file, joints, person, estimate in rows:
            told = str(estimate.verdict), " ".join(estimate.ambiguous)
            row = [step.frame.index, f"{step.frame.time_s:.6f}", *told, *self._values(joints, person, estimate)]
            file.add(csv_lines([row]))
            if step.frame.index not in self._run.resumed:
                file.take_place()

    def _values(self, joints: list[AnatomicalJoint], person: Person, estimate: Estimate) -> list[str]:
        values = np.concatenate(angles_of(joints, person.body, estimate.q[None], estimate.covariance[None]), axis=1)[0]
        return ["" if estimate.lost or np.isnan(value) else f"{value:.{self._decimals}f}" for value in values]

    def finish(self) -> tuple[Path, ...]:
        """Names the tables."""
        return tuple(file.take_place() for file in self._files)


def _checked(person: Person) -> list[AnatomicalJoint]:
    joints = joints_of(person.body)
    if not joints:
        raise ConfigError(
            f'isb_angles: the model "{person.body.name}" of "{person.name}" has no joints of a person, expected '
            "landmarks such as left_hip and left_knee on segments of their own; leave isb_angles out"
        )
    if limb := leaning_limb(person.body):
        raise ConfigError(
            f'isb_angles: {limb} of the model "{person.body.name}" does not hang down in its reference pose, where the '
            "standard's angles are zero; leave isb_angles out"
        )
    return joints
