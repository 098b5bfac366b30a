"""One row a frame, all values side by side: for spreadsheets, pandas, R and MATLAB."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pydantic

from tracker.bodies.scene import Person
from tracker.foundation.configuration.components import component
from tracker.foundation.files import GrowingFile, csv_lines
from tracker.results.recording import RunContext
from tracker.tracking.estimate import Estimate
from tracker.tracking.trajectory import Step

_FIRST = ("frame", "time_s", "status", "ambiguous", "distance_px")


@component
class WideTable:
    """`NAME_wide.csv` for each person: a row a frame, with every parameter, its sigma, and x, y, z of every landmark.

    Columns end in their unit: `left_arm_extension_deg`, `left_arm_extension_sigma_deg`, `left_elbow_x_m`. In lost
    frames the values are empty.
    """

    decimals: int = pydantic.Field(default=5, ge=0, le=15)
    """Digits after the point: 0.01 mm and 0.00001 degrees."""

    def begin(self, run: RunContext) -> WideRecorder:
        """Opens the tables."""
        return WideRecorder(run, self.decimals)


class WideRecorder:
    """The open tables, one a person."""

    def __init__(self, run: RunContext, decimals: int) -> None:
        self._run, self._decimals = run, decimals
        self._files = [self._opened(person) for person in run.scene.persons]

    def _opened(self, person: Person) -> GrowingFile:
        file = GrowingFile(self._run.folder / f"{person.name}_wide.csv", waits=bool(self._run.resumed))
        parameters = person.body.parameters
        sigmas = [f"{parameter.name}_sigma_{parameter.unit}" for parameter in parameters]
        places = [f"{name}_{axis}_m" for name in person.body.landmark_names for axis in "xyz"]
        file.add(csv_lines([[*_FIRST, *(parameter.column for parameter in parameters), *sigmas, *places]]))
        return file

    def write(self, step: Step) -> None:
        """Adds a row to each table."""
        for file, person, estimate in zip(self._files, step.scene.persons, step.estimates, strict=True):
            distance = "" if estimate.lost else f"{estimate.distance_px:.4f}"
            told = str(estimate.verdict), " ".join(estimate.ambiguous), distance
            row = [step.frame.index, f"{step.frame.time_s:.6f}", *told, *self._values(person, estimate)]
            file.add(csv_lines([row]))
            if step.frame.index not in self._run.resumed:
                file.take_place()

    def _values(self, person: Person, estimate: Estimate) -> list[str]:
        body = person.body
        units = np.where(body.rotates, 180 / np.pi, 1.0)
        sigmas = np.sqrt(np.maximum(np.diag(estimate.covariance), 0))
        places = body.landmarks_in_world(estimate.q).ravel()
        values = np.concatenate([units * estimate.q, units * sigmas, places])
        return ["" if estimate.lost or np.isnan(value) else f"{value:.{self._decimals}f}" for value in values]

    def finish(self) -> tuple[Path, ...]:
        """Names the tables."""
        return tuple(file.take_place() for file in self._files)
