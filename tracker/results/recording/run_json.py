"""Configuration and outcome of a run, as JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tracker.bodies.scene import Person
from tracker.foundation.configuration.components import component
from tracker.foundation.files import write_json
from tracker.results.recording import RunContext
from tracker.results.recording._series import Series
from tracker.tracking.trajectory import Step


@component
class RunJson:
    """`run.json`: resolved configuration, versions, input hashes and headline numbers."""

    def begin(self, run: RunContext) -> RunJsonRecorder:
        """Writes the facts known before the first frame; those of an interrupted run stay meanwhile."""
        recorder = RunJsonRecorder(run)
        if not run.resumed:
            recorder.save(complete=False)
        return recorder


class RunJsonRecorder:
    """The numbers so far."""

    def __init__(self, run: RunContext) -> None:
        self._run, self._series, self._waits = run, Series(run.scene), bool(run.resumed)

    def write(self, step: Step) -> None:
        """Adds one frame."""
        self._series.add(step)
        if self._waits and step.frame.index not in self._run.resumed:
            self._waits = False
            self.save(complete=False)

    def finish(self) -> tuple[Path, ...]:
        """Writes the file again with the run's summary."""
        # cameras that film now are stopped at some time, and frames were dropped: nobody goes on with such a run
        whole = "live" in self._run.details or len(self._series.frames) == self._run.n_frames
        return (self.save(complete=whole),)

    def save(self, complete: bool) -> Path:
        """Replaces the file as a whole."""
        content = {
            "name": self._run.name,
            "complete": complete,
            "fps": self._run.fps,
            "interval_s": self._run.interval_s,
            "views": list(self._run.scene.rig.names),
            "persons": [_described(person) for person in self._run.scene.persons],
            "summary": self._series.summary(),
            **self._run.details,
        }
        path = self._run.folder / "run.json"
        write_json(path, content)
        return path


def _described(person: Person) -> dict[str, Any]:
    """The person, with data for an evaluation."""
    body = person.body
    return {
        "name": person.name,
        "model": body.name,
        "stature_m": body.stature_m,
        "sides": body.mirror.sides,
        "joints": body.joints.model_dump(mode="json"),
    }
