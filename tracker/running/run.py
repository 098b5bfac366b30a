"""A configured run, for programs: iterated frame by frame, or executed into a result folder."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from tracker.bodies.scene import Scene
from tracker.foundation.progress import Progress, shown
from tracker.results.result import Result, load_result
from tracker.running.jobs import execute, load_job
from tracker.running.jobs.track import OpenedTrack, TrackJob
from tracker.tracking.sequence import track
from tracker.tracking.trajectory import Step
from tracker.tracking.two_passes import track_twice


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
        way = track if self.job.passes == 1 else track_twice
        return way(opened.frames(), opened.scene, cycle, {}, opened.frames)

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
