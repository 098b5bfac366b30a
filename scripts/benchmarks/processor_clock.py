"""A recorder for the benchmark of recordings: processor time of every frame, whatever commit is run."""

from __future__ import annotations

import time
from pathlib import Path

from tracker.foundation.configuration.components import component
from tracker.results.recording import RunContext
from tracker.tracking.trajectory import Step

FILE = "processor_s.csv"


@component
class ProcessorClock:
    """`processor_s.csv`: seconds of all threads since the frame before, with reading and writing.

    Those of the first frame are all since the process began: importing, loading kernels, fitting bodies, the start.
    """

    def begin(self, run: RunContext) -> ProcessorRecorder:
        """Makes the file."""
        return ProcessorRecorder(run)


class ProcessorRecorder:
    """The clock, last of the recorders."""

    def __init__(self, run: RunContext) -> None:
        self._path = run.folder / FILE
        self._path.write_text("frame,processor_s\n", encoding="utf-8")
        self._before = 0.0

    def write(self, step: Step) -> None:
        """Adds one frame."""
        spent = time.process_time() - self._before
        with self._path.open("a", encoding="utf-8") as file:
            file.write(f"{step.frame.index},{spent:.6f}\n")
        self._before = time.process_time()

    def finish(self) -> tuple[Path, ...]:
        """The file is complete."""
        return (self._path,)
