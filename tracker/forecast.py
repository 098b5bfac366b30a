"""What a run would take: its first frames tracked and thrown away."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from tracker.doubts import Doubts
from tracker.jobs import execute
from tracker.jobs.track import TrackJob, TrackOutcome
from tracker.progress import Progress, silent


@dataclass(frozen=True)
class Forecast:
    """What the first frames tell of all."""

    n_frames: int
    """Frames of the whole run."""

    n_views: int
    start_s: float
    """Time to the end of the first frame: plates, start poses."""

    frame_s: float
    """Time of each further frame, what is written included."""

    doubts: Doubts
    """Of the frames that were tracked."""

    @property
    def seconds(self) -> float:
        """Time of the whole run, if its frames are like the first ones."""
        return self.start_s + self.frame_s * (self.n_frames - 1)


def forecast(job: TrackJob, n_frames: int = 12, progress: Progress = silent) -> Forecast:
    """Does all that a run does, with its first frames, in a folder that is removed.

    Args:
        job: what would be run.
        n_frames: frames to be tracked.
        progress: told how far it is.

    Raises:
        TrackerError: what the run would end with, if its first frames show it.
    """
    sequence = job.open().sequence
    tracked = min(n_frames, sequence.n_frames)
    reading: Any = job.reading  # of whatever kind, it selects frames by start, stop and stride
    short = replace(reading, stop=reading.start + tracked * reading.stride)
    clock = _Clock(progress)
    with tempfile.TemporaryDirectory(prefix="bodytrack-") as folder:
        outcome: TrackOutcome = execute(replace(job, reading=short, passes=1), Path(folder) / "out", progress=clock)
    if outcome.interrupted:
        raise KeyboardInterrupt
    begin, *ends = clock.stamps
    frame_s = (ends[-1] - ends[0]) / (len(ends) - 1) if len(ends) > 1 else ends[0] - begin
    return Forecast(sequence.n_frames, len(sequence.rig), ends[0] - begin, frame_s, outcome.doubts)


@dataclass
class _Clock:
    """Passes progress on, and notes when each frame ends."""

    progress: Progress
    stamps: list[float] = field(default_factory=list)

    def __call__(self, what: str, done: int = 0, total: int = 0, detail: str = "") -> None:
        """Notes the time if a frame has ended."""
        if what == "tracking" and total:
            self.stamps.append(time.perf_counter())
        self.progress(what, done, total, detail)
