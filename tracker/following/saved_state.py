"""What an interrupted following goes on from."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.errors import SequenceError
from tracker.files import replacing
from tracker.following.points import Points, restored

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
    points: Points
    warnings: tuple[str, ...]


def save_state(folder: Path, points: Points, counts: Counts, n_bytes: int) -> None:
    """Writes the state of the present frame in place of an earlier one."""
    told: dict[str, NDArray[Any]] = {
        "frames": np.array(counts.frames),
        "times": np.array(counts.times),
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
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise SequenceError(f"{folder / STATE}: no saved state to go on from; run without --resume") from error
    frames = tuple(int(frame) for frame in arrays["job_frames"])
    times = tuple(float(time_s) for time_s in arrays["job_times"])
    warnings = tuple(map(str, arrays["job_warnings"]))
    return SavedState(frames[-1], int(arrays["job_n_bytes"]), frames, times, restored(arrays), warnings)
