"""Recordings of a finished run, made from its result folder."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from collections.abc import Iterable
from pathlib import Path

from tracker.recording import Recorder, Recording, RunContext
from tracker.recording.csv_table import CsvTable
from tracker.recording.journal import Journal
from tracker.recording.run_json import RunJson
from tracker.result import Result, load_result
from tracker.rig_layouts import save_rig

_DETAILS = (
    *("config", "choices", "images", "versions", "inputs", "findings", "bodies"),
    *("smoothing", "alignment", "alignment_change"),
)
"""What recordings tell of how a result was made."""


def export(result: Path, recordings: Iterable[Recording], output: Path | None = None) -> tuple[Path, ...]:
    """Writes recordings that need poses and times only, no images.

    Args:
        result: folder of a run.
        recordings: what to write.
        output: where to; None for the result folder.

    Returns:
        The files written.

    Raises:
        TrackerError: the folder is not that of a run, or something in it is damaged.
    """
    return write_recordings(load_result(result), recordings, output or result)


def write_recordings(result: Result, recordings: Iterable[Recording], folder: Path) -> tuple[Path, ...]:
    """Writes recordings of a result that is loaded, all of them or none; see `export`."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".export-", dir=folder) as unfinished:
        files = _written(result, recordings, Path(unfinished))
        return tuple(sorted(file.replace(folder / file.name) for file in files))


def _written(result: Result, recordings: Iterable[Recording], folder: Path) -> list[Path]:
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
        for step in result.steps():
            for recorder in recorders:
                recorder.write(step)
    return files


def write_result(result: Result, folder: Path) -> None:
    """Writes a result, whose poses were changed after the run, as one that loads, exports and is evaluated like it.

    Args:
        result: with the poses as they are now; `folder` is that of the run.
        folder: where to.
    """
    write_recordings(result, [CsvTable(), RunJson(), Journal()], folder)
    save_rig(result.rig, folder / "rig.toml")
    shutil.copytree(result.folder / "models", folder / "models")


def _finish(recorder: Recorder, files: list[Path]) -> None:
    files.extend(recorder.finish())
