"""The record of a following: every sighting in one growing file, read again as trajectories."""

from __future__ import annotations

from bisect import bisect_left
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.foundation.arrays import Integers
from tracker.foundation.errors import SequenceError
from tracker.points.trajectories import PointFrame, PointStatus, PointTrajectories

Rows = NDArray[Any]
"""Sightings; the columns are those of `sighting_type`."""


AT_A_TIME = 100_000
"""Sightings that are read at a time where their order does not matter: 15 MB with three views."""


def sighting_type(n_views: int) -> np.dtype[Any]:
    """Columns of a sighting, metres and px; rows are in the order of the frames."""
    return np.dtype(
        [
            ("frame", "<i4"),
            ("id", "<i4"),
            ("status", "<i4"),
            ("born", "<i4"),
            ("position", "<f8", 3),
            ("covariance", "<f4", (3, 3)),
            ("drift_px", "<f4"),
            ("pixels", "<f4", (n_views, 2)),
            ("sigmas_px", "<f4", (n_views, 2)),
            ("keys", "<i4", (n_views,)),
        ]
    )


def rows_of(frame: PointFrame) -> Rows:
    """The sightings of a frame."""
    seen = frame.alive
    rows = np.zeros(int(seen.sum()), dtype=sighting_type(len(frame.pixels)))
    rows["frame"], rows["id"], rows["status"] = frame.index, frame.ids[seen], frame.status[seen]
    rows["born"], rows["keys"] = frame.born[seen], frame.keys[:, seen].T
    rows["position"], rows["covariance"] = frame.positions[seen], frame.covariances[seen]
    rows["drift_px"] = frame.drift_px[seen]
    rows["pixels"] = frame.pixels[:, seen].swapaxes(0, 1)
    rows["sigmas_px"] = frame.sigmas_px[:, seen].swapaxes(0, 1)
    return rows


def append(path: Path, frame: PointFrame) -> None:
    """Writes the sightings of a frame behind those of the others."""
    with path.open("ab") as file:
        file.write(rows_of(frame).tobytes())


def shortened(path: Path, n_bytes: int) -> None:
    """Takes away what was written after a length: frames that are to be followed again.

    Raises:
        SequenceError: the file is shorter than that.
    """
    if not path.is_file() or path.stat().st_size < n_bytes:
        raise SequenceError(f"{path}: shorter than the saved state says; run without --resume")
    with path.open("r+b") as file:
        file.truncate(n_bytes)


def read(path: Path, n_views: int) -> Rows:
    """All sightings, read from the file as they are needed."""
    if path.stat().st_size == 0:
        return np.zeros(0, dtype=sighting_type(n_views))
    return np.memmap(path, dtype=sighting_type(n_views), mode="r")


def between(rows: Rows, first: int, last: int) -> Rows:
    """The sightings in the frames from the first number to before the last one; no others are read."""
    numbers = rows["frame"]
    return np.asarray(rows[bisect_left(numbers, first) : bisect_left(numbers, last)])


def trajectories_of(rows: Rows, frames: Integers, times: NDArray[np.float64]) -> PointTrajectories:
    """Trajectories in space, or in the image where there is one view alone.

    Args:
        rows: sightings.
        frames: (T,) all frame numbers, also of frames without a sighting.
        times: (T,) seconds.
    """
    n_views = rows["pixels"].shape[1]
    flat = n_views == 1
    ids, first = np.unique(rows["id"], return_index=True)
    t, n, shape = np.searchsorted(frames, rows["frame"]), np.searchsorted(ids, rows["id"]), (len(frames), len(ids))

    def spread(values: NDArray[Any], empty: float) -> NDArray[Any]:
        kind = np.int64 if values.dtype.kind == "i" else np.float64
        table = np.full((*shape, *values.shape[1:]), empty, dtype=kind)
        table[t, n] = values
        return table

    in_image = np.einsum("ni,ij->nij", rows["sigmas_px"][:, 0].astype(np.float64) ** 2, np.eye(2))
    return PointTrajectories(
        frames,
        times,
        ids.astype(np.int64),
        rows["born"][first].astype(np.int64),
        spread(rows["pixels"][:, 0] if flat else rows["position"], np.nan),
        spread(in_image if flat else rows["covariance"], np.nan),
        spread(rows["pixels"], np.nan).swapaxes(1, 2),
        spread(rows["keys"], -1).swapaxes(1, 2),
        spread(rows["drift_px"], np.nan),
        spread(rows["status"], int(PointStatus.HIDDEN)),
    )
