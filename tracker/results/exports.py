"""Recordings of a finished run, made from its result folder."""

from __future__ import annotations

import contextlib
import logging
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from tracker.cameras.frame import Frame
from tracker.cameras.rig_layouts import save_rig
from tracker.foundation.errors import ConfigError, TrackerError
from tracker.foundation.files import check_empty, check_free
from tracker.foundation.progress import Progress, silent
from tracker.foundation.source_files import json_of
from tracker.results.recording import Recorder, Recording, RunContext
from tracker.results.recording.csv_table import CsvTable
from tracker.results.recording.journal import Journal
from tracker.results.recording.run_json import RunJson
from tracker.results.result import Result
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.trajectory import Step

log = logging.getLogger("tracker")

EXPORTS = "exports"
"""Folder in a result for exports after the run."""

_DETAILS = (
    *("config", "choices", "images", "versions", "inputs", "findings", "keypoints", "bodies"),
    *("smoothing", "alignment", "alignment_change"),
)
"""Statements of recordings about how a result was made."""


def write_recordings(
    result: Result, recordings: Iterable[Recording], folder: Path, overwrite: bool = False
) -> tuple[Path, ...]:
    """Writes recordings that need only poses and times, no images: all of them or none.

    Args:
        result: of a run.
        recordings: the formats.
        folder: place of the files; it is created.
        overwrite: replace existing files.

    Returns:
        Paths of the files.

    Raises:
        TrackerError: a format cannot hold the result, or a file exists already.
    """
    new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryDirectory(prefix=".export-", dir=folder) as unfinished:
            files = _written(result, recordings, Path(unfinished), result.steps())
            check_free((folder / file.name for file in files), overwrite)
            return tuple(sorted(file.replace(folder / file.name) for file in files))
    finally:
        if new:
            with contextlib.suppress(OSError):
                folder.rmdir()  # where nothing was written


def write_pictures(
    result: Result, recordings: Iterable[Recording], frames: Iterable[Frame], folder: Path, progress: Progress = silent
) -> None:
    """Writes recordings that show images and contours.

    Args:
        result: the poses.
        recordings: the formats.
        frames: of the result's recording, in order; without an image only the contours are shown.
        folder: with the result's tables, for a report's links.
        progress: gets the frames written.
    """
    _written(result, recordings, folder, _pictured(result, frames, progress))


def _pictured(result: Result, frames: Iterable[Frame], progress: Progress) -> Iterator[Step]:
    """The steps of a result with images and contours."""
    synthesis, left = CpuSynthesis(), iter(frames)
    for n, step in enumerate(result.steps(), start=1):
        progress("drawing", n, len(result.replays))
        frame = _next(left, step.frame.index) or step.frame
        yield replace(step, frame=replace(frame, time_s=step.frame.time_s), fitted=synthesis.contours(step.scene))


def _next(frames: Iterator[Frame], index: int) -> Frame | None:
    """The frame with a number among those that follow; None if it cannot be read."""
    try:
        return next((frame for frame in frames if frame.index >= index), None)
    except TrackerError as error:
        log.warning("no more images: %s", error)
        return None


def _written(result: Result, recordings: Iterable[Recording], folder: Path, steps: Iterable[Step]) -> list[Path]:
    context = RunContext(
        name=result.name,
        folder=folder,
        scene=result.scene,
        fps=result.fps,
        interval_s=result.interval_s,
        n_frames=len(result.replays),
        details={key: result.details[key] for key in _DETAILS if key in result.details},
    )
    files: list[Path] = []
    with contextlib.ExitStack() as closing:
        recorders: list[Recorder] = []
        for recording in recordings:
            recorders.append(recording.begin(context))
            closing.callback(_finish, recorders[-1], files)
        for step in steps:
            for recorder in recorders:
                recorder.write(step)
    return files


def write_result(result: Result, folder: Path) -> None:
    """Writes a result with changed poses; it loads, exports and is evaluated like the run's.

    Args:
        result: with the changed poses; `folder` is that of the run.
        folder: of the new result.
    """
    write_recordings(result, [CsvTable(), RunJson(), Journal()], folder)
    save_rig(result.rig, folder / "rig.toml")
    shutil.copytree(result.folder / "models", folder / "models")


def check_place(folder: Path, change: str, overwrite: bool) -> None:
    """Refuses a folder that is not empty, except for a changed result that may be replaced.

    Args:
        folder: may be missing.
        change: key of such results in run.json: one of `tracker.results.result.CHANGED`.
        overwrite: whether such a result may be replaced; other files never are.

    Raises:
        ConfigError: the folder is not empty.
    """
    told = folder / "run.json"
    replaceable = told.is_file() and change in json_of(told, ConfigError)
    if not (replaceable and overwrite):
        check_empty(folder, replaceable)


def _finish(recorder: Recorder, files: list[Path]) -> None:
    files.extend(recorder.finish())
