"""Compares a result's views with each other, and writes its poses at one moment into a result folder beside it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from tracker.cameras.rig_layouts import load_rig, save_rig
from tracker.foundation.errors import ConfigError
from tracker.foundation.files import whole_folder
from tracker.foundation.progress import Progress, silent
from tracker.results.alignment import ViewAlignment
from tracker.results.alignment.adjustment import align, in_step, turned
from tracker.results.alignment.moments import Tracked, chosen_moments, moments_of
from tracker.results.exports import check_place, write_result
from tracker.results.result import Result
from tracker.running.viewing.images import IN_STEP, images_of, reading_of
from tracker.tracking.estimate import Estimate

_DECIMALS = 6
"""Decimals of figures in files: microseconds and millionths of a degree or px."""


def alignment_of(result: Result, progress: Progress = silent) -> ViewAlignment:
    """Delays and turns of the views of a finished run, by its fastest frames without doubt.

    Args:
        result: of any body and evidence.
        progress: gets the frames read.

    Raises:
        ConfigError: the run has too few such frames, or one view.
        TrackerError: the recording is gone.
    """
    frames = tracked_in(result)
    progress("reading the fastest frames")
    moments = moments_of(result.scene, frames, chosen_moments(result.scene, frames), images_of(result))
    found = align(moments, result.interval_s, progress)
    if found is None:
        views = f"{len(result.rig)} view{'s' if len(result.rig) > 1 else ''}"
        raise ConfigError(
            f"{result.folder}: {len(moments)} frames with movement and without doubt, in {views}: "
            "too few to compare views by; expected movement in two views or more"
        )
    return found


def tracked_in(result: Result) -> list[Tracked]:
    """The frames of a run as `tracker.results.alignment` takes them."""
    return [Tracked(replay.index, replay.time_s, replay.estimates) for replay in result.replays]


def write_in_step(
    result: Result,
    found: ViewAlignment,
    folder: Path | None = None,
    progress: Progress = silent,
    overwrite: bool = False,
) -> Path:
    """Writes a result folder of the poses at the first view's moment; it loads and is evaluated as any other.

    Args:
        result: the poses as tracked.
        found: delays of the views.
        folder: written as a whole or not at all; None for the folder `in_step` in the result.
        progress: gets the frames read.
        overwrite: replace such an earlier result, with all that was made of it.

    Returns:
        The folder.

    Raises:
        ConfigError: the folder is not empty.
        TrackerError: the recording is gone.
    """
    target = folder_in_step(result, folder, overwrite)
    with whole_folder(target, overwrite) as unfinished:
        changed = dict(_counted(result, found, progress))
        replays = tuple(
            replace(replay, estimates=changed.get(replay.index, replay.estimates)) for replay in result.replays
        )
        details = {**result.details, "alignment": described(found)}
        if found.change is not None:
            details["alignment_change"] = dict(zip(("after_frame", "before_frame"), found.change.between, strict=True))
        write_result(replace(result, replays=replays, details=details), unfinished)
    return target


def folder_in_step(result: Result, folder: Path | None = None, overwrite: bool = False) -> Path:
    """Folder of `write_in_step`; asked before the slow comparison of the views.

    Args:
        result: the poses as tracked.
        folder: of the new result; None for the folder `in_step` in the result.
        overwrite: whether it may hold such a result.

    Raises:
        ConfigError: the folder is not empty.
    """
    target = folder or result.folder / IN_STEP
    check_place(target, "alignment", overwrite)
    return target


def write_turned_rig(result: Result, found: ViewAlignment, path: Path, overwrite: bool = False) -> Path:
    """Writes the rig of the recording, with its cameras turned as the persons show, for another run.

    Args:
        result: the run.
        found: turns of the cameras.
        path: a TOML file.
        overwrite: replace an existing file.

    Returns:
        The file.

    Raises:
        ConfigError: the file exists, or its folder does not.
        TrackerError: the run's calibration is gone.
    """
    check_new_file(path, overwrite)
    reading = reading_of(result)
    save_rig(turned(load_rig(reading.rig, result.rig.names), found.turns), path)
    return path


def check_new_file(path: Path, overwrite: bool = False) -> None:
    """Refuses a path where a rig would replace a file unasked.

    Raises:
        ConfigError: the file exists, or its folder does not.
    """
    if (path.exists() and not overwrite) or not path.absolute().parent.is_dir():
        raise ConfigError(f"--rig {path}: expected a file that is not there yet, in a folder that is")


def _counted(result: Result, found: ViewAlignment, progress: Progress) -> Iterator[tuple[int, tuple[Estimate, ...]]]:
    poses = in_step(result.scene, tracked_in(result), found, images_of(result))
    for done, frame in enumerate(poses, start=1):
        progress("bringing poses to one moment", done, len(result.replays))
        yield frame


def described(found: ViewAlignment) -> dict[str, dict[str, float]]:
    """View -> its delay and turn, in ms, degrees and px; `late_before_ms` and `late_after_ms` if the delay changes."""
    told = {
        "late_ms": 1000 * found.delays_s,
        "late_sigma_ms": 1000 * found.delay_sigmas_s,
        "turned_deg": np.degrees(np.linalg.norm(found.turns, axis=1)),
        "turned_px": found.turned_px,
    }
    if found.change is not None:
        told["late_before_ms"], told["late_after_ms"] = 1000 * found.change.before_s, 1000 * found.change.after_s
    return {
        name: {key: round(float(values[view]), _DECIMALS) for key, values in told.items()}
        for view, name in enumerate(found.rig.names)
    }
