"""The Python interface: does the work of the commands `simulate` and `result`, and returns values."""

from __future__ import annotations

import dataclasses
import logging
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from tracker.acquisition.body_fit import LONGEST
from tracker.bodies.scene import Scene
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import read_rig
from tracker.foundation.configuration.tables import build
from tracker.foundation.errors import ConfigError, nearest
from tracker.foundation.files import check_empty
from tracker.foundation.progress import Progress, shown, silent
from tracker.results.evaluation.comparison import Evaluation
from tracker.results.evaluation.comparison import evaluate as compared
from tracker.results.exports import EXPORTS, write_recordings
from tracker.results.recording import Recording
from tracker.results.recording.overlay import Overlay
from tracker.results.recording.report import Report
from tracker.results.result import Result, load_result
from tracker.results.smoothed_result import Pictures, write_smoothed
from tracker.results.smoothing import Smoothing
from tracker.running.jobs import execute, load_job
from tracker.running.jobs.track import OpenedTrack, TrackJob, TrackOutcome
from tracker.running.viewing.images import images_of
from tracker.synthesis.simulation.filming import film, plan
from tracker.synthesis.simulation.prospect import Prospect
from tracker.synthesis.simulation.room import default_rig
from tracker.synthesis.simulation.sequence import Recipe
from tracker.tracking.doubts import Doubts
from tracker.tracking.trajectory import Step

_FIT_S = 5.0
"""Time of twelve frames in four views: `human`, one core."""


@dataclass(frozen=True)
class Forecast:
    """Estimate of a run from its first frames."""

    n_frames: int
    """Frames of the whole run."""

    n_views: int
    start_s: float
    """Time to the end of the first frame: plates, start poses."""

    frame_s: float
    """Time of each further frame, including writing."""

    doubts: Doubts
    """Frames that were tracked."""

    n_fitted: int = 0
    """Persons whose bodies are fitted before, in the first frames, which are tracked there and back."""

    @property
    def seconds(self) -> float:
        """Time of the whole run, if its frames are like the first ones."""
        n_before = 2 * min(self.n_frames, LONGEST) if self.n_fitted else 0
        return self.start_s + self.frame_s * (self.n_frames - 1 + n_before) + 2 * _FIT_S * self.n_fitted


def forecast(job: TrackJob, n_frames: int = 12, progress: Progress = silent) -> Forecast:
    """Does all that a run does, for its first frames and with unfitted bodies, in a temporary folder.

    If the recording begins before its persons come in, it takes the first frames in view.

    Args:
        job: the run.
        n_frames: frames to track.
        progress: told how far it is.

    Raises:
        TrackerError: the run would fail with it, if its first frames show that.
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

    Iterating tracks from the first frame on and writes nothing; every iteration begins anew.
    """

    job: TrackJob
    """Its components, as configured."""

    @cached_property
    def opened(self) -> OpenedTrack:
        """The recording and the models, opened and checked on first use.

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
            TrackerError: an input cannot be used, or the first frames show no start pose.
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
            progress: receiver of the progress; None for bars in a notebook, and nothing elsewhere.

        Raises:
            TrackerError: as for `bodytrack run`.
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


FORMATS = ("bvh", "c3d", "glb", "isb_angles", "mot", "opensim", "osim", "trc", "wide_table")
"""Recordings that need only poses and times."""

_PLANNED = {"movement", "rig", "place", "heading_deg"}
"""Fields of a recipe that `simulate` has as arguments of its own."""

log = logging.getLogger("tracker")

Wanted = str | Iterable[str | Recording] | Mapping[str, Mapping[str, Any]]
"""Formats: "trc,c3d", ["trc", "c3d"], or with their fields {"trc": {"y_up": True}}."""


@dataclasses.dataclass(frozen=True)
class Simulated:
    """A recording of a simulated person, and the expected errors."""

    config: Path
    """Configuration for `load_run`; the truth lies in its folder, for `evaluate`."""

    expected: Prospect
    """Standard deviations of joints and angles, the gain of each view, hidden parts."""


def evaluate(result: Result | Path | str, truth: Path | str) -> Evaluation:
    """Compares a result with a truth: distances of joints, angles, lost frames, silhouettes.

    Args:
        result: a result, or its folder.
        truth: table of joints, or a folder that holds one: of a simulated recording, for instance.

    Raises:
        TrackerError: files are missing or damaged, or have no frame or joint in common.
    """
    return compared(result.folder if isinstance(result, Result) else Path(result), Path(truth))


def smooth(
    result: Result | Path | str,
    use: str = "rts",
    output: Path | str | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
    **fields: Any,
) -> Result:
    """Smooths a result and fills its short gaps, into a result folder of its own.

    Args:
        result: a result, or its folder.
        use: method: rts, butterworth, spline or one_euro.
        output: folder to write; None for `smoothed` in the result's.
        overwrite: replace an earlier smoothed result, with all that was made of it.
        progress: receiver of the progress; None for a bar in a notebook, and nothing elsewhere.
        **fields: of the smoothing, `cutoff_hz=8.0` for instance.

    Returns:
        The smoothed result.

    Raises:
        TrackerError: a field is wrong, the frame rate too low for it, or the folder is not empty.
    """
    smoothing: Smoothing = build("smoothing", {"use": use, **fields}, "smooth", Path())
    return smooth_by(smoothing, _loaded(result), Path(output) if output else None, overwrite, progress or shown())


def smooth_by(smoothing: Smoothing, raw: Result, output: Path | None, overwrite: bool, progress: Progress) -> Result:
    """Smooths a result, with report and overlay; see `smooth`."""
    pictures = Pictures((Report(), Overlay()), lambda: images_of(raw), progress)
    return load_result(write_smoothed(raw, smoothing, output, overwrite, pictures))


def export(
    result: Result | Path | str, to: Wanted, output: Path | str | None = None, overwrite: bool = False
) -> tuple[Path, ...]:
    """Writes a result for other programs.

    Args:
        result: a result, or its folder.
        to: formats: "trc,c3d", ["trc", "c3d"], or with their fields {"trc": {"y_up": True}}.
        output: folder to write; None for `exports` in the result's.
        overwrite: replace existing files.

    Returns:
        The files written: all, or none.

    Raises:
        TrackerError: the format does not exist, the result cannot be written in it, or a file exists already.
    """
    recordings = _recordings(to)
    loaded = _loaded(result)
    return write_recordings(loaded, recordings, Path(output) if output else loaded.folder / EXPORTS, overwrite)


def simulate(
    rig: Rig | Path | str | None = None,
    movement: str = "walk",
    output: Path | str | None = None,
    *,
    place: tuple[float, float] | None = None,
    heading_deg: float | None = None,
    edge_px: float = 1.0,
    progress: Progress | None = None,
    **recipe: Any,
) -> Simulated:
    """Films a simulated body with your cameras.

    Args:
        rig: cameras, or their calibration; None for four in the corners of a room.
        movement: of the model's file.
        output: folder to create; None for `results/simulated/MOVEMENT`.
        place: middle of the way, x and y, metres; None for the middle of the area that most cameras see.
        heading_deg: direction faced at the start, from x; None for the one that keeps most of the way in the pictures.
        edge_px: error of an edge, px, for the expected standard deviations.
        progress: default a bar in a notebook, and nothing elsewhere.
        **recipe: of `synthesis.simulation.sequence.Recipe`: `model`, `seconds`, `fps`, `size`, `stature_m`, `seed`, ...

    Raises:
        TrackerError: these settings cannot be filmed, or the folder is not empty.
    """
    valid = {field.name for field in dataclasses.fields(Recipe)} - _PLANNED
    for name in recipe.keys() - valid:
        raise ConfigError(f'simulate: unknown argument "{name}"; {nearest(name, valid)}')
    asked = Recipe(movement, **recipe)
    cameras = default_rig(asked.size) if rig is None else rig if isinstance(rig, Rig) else _read(Path(rig))
    planned = plan(asked, cameras, place, heading_deg)
    folder = Path(output) if output else Path("results") / "simulated" / planned.recipe.movement
    check_empty(folder)
    expected = planned.prospect(edge_px)
    return Simulated(film(planned, expected, folder, progress or shown()), expected)


def _loaded(result: Result | Path | str) -> Result:
    return result if isinstance(result, Result) else load_result(result)


def _read(path: Path) -> Rig:
    opened = read_rig(path)
    for line in opened.told():
        log.warning("%s: %s", path, line)
    return opened.rig


def _recordings(to: Wanted) -> list[Recording]:
    """Recorders of the formats, each once."""
    asked = dict.fromkeys(filter(None, to.split(","))) if isinstance(to, str) else to
    fields = to if isinstance(to, Mapping) else {}
    made = [one if isinstance(one, Recording) else _recording(one, fields.get(one, {})) for one in asked]
    if not made:
        raise ConfigError(f"no format to export to: expected one or more of {', '.join(FORMATS)}")
    return made


def _recording(name: str, fields: Mapping[str, Any]) -> Recording:
    if name not in FORMATS:
        raise ConfigError(f'no format "{name}" to export to; {nearest(name, FORMATS)}')
    made: Recording = build("recording", {"use": name, **fields}, f"export to {name}", Path())
    return made
