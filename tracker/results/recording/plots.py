"""Pose-parameter plots like the paper's figure 8."""

from __future__ import annotations

from pathlib import Path

import pydantic

from tracker.foundation.configuration.components import component
from tracker.foundation.files import write_whole
from tracker.results.recording import RunContext
from tracker.results.recording._series import Series, parameter_figure, png_of
from tracker.tracking.trajectory import Step


@component
class Plots:
    """`parameters.png`, or `parameters_NAME.png` for each of several persons."""

    dpi: int = pydantic.Field(default=110, ge=50)
    """Resolution, dots per inch."""

    def begin(self, run: RunContext) -> PlotsRecorder:
        """Collects the parameters; the plots are drawn at the end."""
        return PlotsRecorder(run, self.dpi)


class PlotsRecorder:
    """The parameters so far."""

    def __init__(self, run: RunContext, dpi: int) -> None:
        self._run, self._dpi, self._series = run, dpi, Series(run.scene)

    def write(self, step: Step) -> None:
        """Adds one frame."""
        self._series.add(step)

    def finish(self) -> tuple[Path, ...]:
        """Draws the plots."""
        persons = self._run.scene.persons if self._series.frames else ()
        written = []
        for k, person in enumerate(persons):
            name = "parameters.png" if len(persons) == 1 else f"parameters_{person.name}.png"
            written.append(self._run.folder / name)
            self._run.figures[person.name] = png_of(parameter_figure(self._series, k), self._dpi)
            write_whole(written[-1], self._run.figures[person.name])
        return tuple(written)
