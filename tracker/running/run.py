"""A configured run, for programs: iterated frame by frame, or executed into a result folder."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from tracker.acquisition.from_recording import LONGEST
from tracker.bodies.scene import Scene
from tracker.foundation.progress import Progress, shown, silent
from tracker.results.result import Result, load_result
from tracker.running.jobs import execute, load_job
from tracker.running.jobs.track import OpenedTrack, TrackJob, TrackOutcome
from tracker.tracking.doubts import Doubts
from tracker.tracking.trajectory import Step

_FIT_S = 5.0
"""Of twelve frames in four views: `human`, one core."""


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

    n_fitted: int = 0
    """Persons whose bodies are fitted before: the first frames are tracked there and back for that."""

    @property
    def seconds(self) -> float:
        """Time of the whole run, if its frames are like the first ones."""
        n_before = 2 * min(self.n_frames, LONGEST) if self.n_fitted else 0
        return self.start_s + self.frame_s * (self.n_frames - 1 + n_before) + 2 * _FIT_S * self.n_fitted


def forecast(job: TrackJob, n_frames: int = 12, progress: Progress = silent) -> Forecast:
    """Does all that a run does, with its first frames and bodies as the models have them, in a folder that is removed.

    Of a recording that begins before its persons come in, with the first frames in view.

    Args:
        job: what would be run.
        n_frames: frames to be tracked.
        progress: told how far it is.

    Raises:
        TrackerError: what the run would end with, if its first frames show it.
    """
    opened = job.open()
    sequence = opened.sequence
    reading: Any = job.reading  # it selects frames by start, stop and stride, unless it has a single one
    start, stride = getattr(reading, "start", 0), getattr(reading, "stride", 1)
    begin = max(start, job.cycle(opened, progress).nobody_before)
    tracked = min(n_frames, sequence.n_frames - (begin - start) // stride)
    short = reading
    if hasattr(reading, "stop"):
        short = replace(reading, start=begin, stop=begin + (tracked - 1) * stride + 1)
    clock = _Clock(progress)
    as_modelled: Any = tuple(replace(one, shape="model") for one in job.persons)
    with tempfile.TemporaryDirectory(prefix="bodytrack-") as folder:
        asked = replace(job, reading=short, passes=1, persons=as_modelled)
        outcome: TrackOutcome = execute(asked, Path(folder) / "out", progress=clock)
    if outcome.interrupted:
        raise KeyboardInterrupt
    began_s, *ends = clock.stamps
    n_fitted = sum(one.is_fitted for one in job.persons)
    frame_s = (ends[-1] - ends[0]) / (len(ends) - 1) if len(ends) > 1 else ends[0] - began_s
    return Forecast(sequence.n_frames, len(sequence.rig), ends[0] - began_s, frame_s, outcome.doubts, n_fitted)


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


@dataclass(frozen=True)
class Run:
    """A tracking job with its inputs.

    Iterated, it tracks from the first frame on and writes nothing; every iteration begins anew.
    """

    job: TrackJob
    """Its components, as configured."""

    @cached_property
    def opened(self) -> OpenedTrack:
        """The recording and the models, opened and checked when first asked for.

        Raises:
            TrackerError: an input cannot be used.
        """
        return self.job.open()

    @property
    def scene(self) -> Scene:
        """The persons at rest, and the cameras."""
        return self.opened.scene

    def __len__(self) -> int:
        """Number of frames."""
        return self.opened.sequence.n_frames

    def __iter__(self) -> Iterator[Step]:
        """Tracks: one step a frame, with images, scene, estimates and evidence.

        Raises:
            TrackerError: an input cannot be used, or no start pose was found in the first frames.
        """
        opened, cycle = self.job.fitted(self.opened, self.job.cycle(self.opened))
        return self.job.followed(opened, cycle)

    def execute(
        self, output: Path | str | None = None, resume: bool = False, progress: Progress | None = None
    ) -> Result:
        """Tracks into a result folder, as `bodytrack run` does.

        Args:
            output: result folder; None for `results/NAME/TIME`.
            resume: continue an interrupted run there, or the latest one.
            progress: told how far it is; None for bars in a notebook, and nothing elsewhere.

        Raises:
            TrackerError: as `bodytrack run` has it.
        """
        outcome = execute(self.job, None if output is None else Path(output), resume, progress or shown())
        return load_result(outcome.folder)


def load_run(config: Path | str, overrides: Sequence[str] = ()) -> Run:
    """Reads the configuration of a run.

    Args:
        config: TOML file; relative paths in it start at its folder.
        overrides: `section.key=value`, as `bodytrack run --set` takes them.

    Raises:
        ConfigError: names file, section, key and the nearest valid one.
    """
    return Run(load_job("track", Path(config), overrides))
