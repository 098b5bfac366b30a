"""What an interrupted following goes on from."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.foundation.errors import SequenceError
from tracker.foundation.files import replacing
from tracker.points.following.points import Points, restored

STATE = "state.npz"
"""In the result folder."""


@dataclass
class Counts:
    """What has been followed so far."""

    frames: list[int] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    seconds: float = 0.0
    interrupted: bool = False
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class SavedState:
    """As it was after a frame."""

    frame: int
    n_bytes: int
    """Length of the record of sightings then."""

    frames: tuple[int, ...]
    times: tuple[float, ...]
    seconds: float
    """That the following has taken until then."""

    points: Points
    warnings: tuple[str, ...]


def save_state(folder: Path, points: Points, counts: Counts, n_bytes: int) -> None:
    """Writes the state of the present frame in place of an earlier one.

    Frames without enough images, which the points have passed over since, are left out: the next frame is compared with
    the one before these, and they have no sightings.
    """
    n_frames = counts.frames.index(points.latest) + 1
    told: dict[str, NDArray[Any]] = {
        "frames": np.array(counts.frames[:n_frames]),
        "times": np.array(counts.times[:n_frames]),
        "seconds": np.array(counts.seconds),
        "n_bytes": np.array(n_bytes),
        "warnings": np.array(counts.warnings, dtype=np.str_),
    }
    with replacing(folder / STATE) as unfinished:
        np.savez(unfinished, **{f"job_{name}": value for name, value in told.items()}, **points.arrays())  # type: ignore[arg-type]


def saved_state(folder: Path) -> SavedState:
    """The state that an interrupted following has left.

    Raises:
        SequenceError: there is none that can be read.
    """
    try:
        with np.load(folder / STATE) as saved:
            arrays = {name: saved[name] for name in saved.files}
        frames = tuple(int(frame) for frame in arrays["job_frames"])
        times = tuple(float(time_s) for time_s in arrays["job_times"])
        warnings, seconds = tuple(map(str, arrays["job_warnings"])), float(arrays["job_seconds"])
        n_bytes, points = int(arrays["job_n_bytes"]), restored(arrays)
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        # a KeyError: of a version that knew less
        raise SequenceError(f"{folder / STATE}: no saved state to go on from; run without --resume") from error
    return SavedState(frames[-1], n_bytes, frames, times, seconds, points, warnings)
