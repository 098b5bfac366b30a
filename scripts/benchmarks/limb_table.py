"""A recorder for fitting doubt: what a run knows of every limb in every frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tracker.foundation.configuration.components import component
from tracker.foundation.files import csv_lines
from tracker.results.recording import RunContext
from tracker.tracking.limb_probabilities import known_of
from tracker.tracking.trajectory import Step

FILE = "limbs_known.csv"
_COLUMNS = "frame", "person", "joints", "left_over", "whole", "spread_m", "stops", "jumped", "flagged"


@component
class LimbTable:
    """`limbs_known.csv`: a row a frame, person and limb."""

    def begin(self, run: RunContext) -> LimbRecorder:
        """Makes the file."""
        return LimbRecorder(run)


class LimbRecorder:
    """The open table."""

    def __init__(self, run: RunContext) -> None:
        self._path = run.folder / FILE
        self._path.write_text(csv_lines([_COLUMNS]), encoding="utf-8")

    def write(self, step: Step) -> None:
        """Adds the rows of one frame."""
        rows: list[tuple[object, ...]] = []
        for person, estimate in zip(step.scene.persons, step.estimates, strict=True):
            body, names = person.body, np.array(person.body.landmark_names)
            for limb, *known in zip(body.limbs, *known_of(body, estimate), strict=True):
                numbers = (f"{number:.5f}" for number in known)
                flagged = int(any(doubt.limb in ("", limb) for doubt in estimate.doubts))
                joints = " ".join(names[body.landmarks_of(limb)])
                rows.append((step.frame.index, person.name, joints, *numbers, flagged))
        with self._path.open("a", encoding="utf-8") as file:
            file.write(csv_lines(rows))

    def finish(self) -> tuple[Path, ...]:
        """The file is complete."""
        return (self._path,)
