"""The demonstration: a simulated recording, tracked from bootstrapping and compared with its truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import pydantic

from tracker.bodies.body.description import load_body
from tracker.foundation.configuration.components import component
from tracker.foundation.progress import Progress
from tracker.foundation.resources import model_path
from tracker.results.evaluation.comparison import Evaluation, evaluate
from tracker.running.jobs import ResultFolder, execute, load_job
from tracker.running.jobs.track import TrackOutcome
from tracker.synthesis.simulation.movements import movement_of
from tracker.synthesis.simulation.sequence import Recipe, write_sequence


@component
class DemoJob:
    """Simulates a clothed person in a cluttered room, tracks it from bootstrapping, and compares with the truth."""

    resumable: ClassVar[bool] = False

    name: str = "demo"
    """Name of the results' folder: `results/NAME/TIME`."""

    movement: str = "two_elbow_rotation"
    """Movement simulated."""

    frames: int = pydantic.Field(default=75, ge=5)
    """Number of frames."""

    seed: int = pydantic.Field(default=0, ge=0)
    """Chooses the room and the noise."""

    def open(self, earlier: Path | None = None) -> Recipe:
        """Checks the simulation's settings; see `tracker.running.jobs.Job.open`."""
        movement_of(self.movement, load_body(model_path(Recipe.model)))
        return Recipe(self.movement, seconds=self.frames / Recipe.fps, seed=self.seed)

    def execute(self, opened: Recipe, folder: ResultFolder, progress: Progress) -> DemoOutcome:
        """Simulates to `sequence/`, tracks to `tracking/` and compares; see `tracker.running.jobs.Job.execute`."""
        config = write_sequence(opened, folder.path / "sequence", progress)
        folder.keep()
        result: TrackOutcome = execute(load_job("track", config), folder.path / "tracking", progress=progress)
        comparable = result.n_frames > 0
        return DemoOutcome(result, evaluate(result.folder, folder.path / "sequence") if comparable else None)


@dataclass(frozen=True)
class DemoOutcome:
    """Outcome of the demonstration."""

    result: TrackOutcome
    evaluation: Evaluation | None
    """None if it was interrupted before the first frame."""

    @property
    def folder(self) -> Path:
        """Folder of the tracking's results."""
        return self.result.folder
