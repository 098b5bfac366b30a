"""The record of a following: every sighting in one growing file, read again as trajectories."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.arrays import Integers
from tracker.errors import SequenceError
from tracker.point_trajectories import PointFrame, PointStatus, PointTrajectories

Rows = NDArray[Any]
"""Sightings; the columns are those of `sighting_type`."""


def sighting_type(n_views: int) -> np.dtype[Any]:
    """Columns of a sighting, metres and px."""
    return np.dtype(
        [
            ("frame", "<i4"),
            ("id", "<i4"),
            ("status", "<i4"),
            ("position", "<f8", 3),
            ("sigma", "<f4", 3),
            ("drift_px", "<f4"),
            ("pixels", "<f4", (n_views, 2)),
            ("sigmas_px", "<f4", (n_views, 2)),
        ]
    )


def rows_of(frame: PointFrame) -> Rows:
    """The sightings of a frame."""
    seen = frame.alive
    rows = np.zeros(int(seen.sum()), dtype=sighting_type(len(frame.pixels)))
    rows["frame"], rows["id"], rows["status"] = frame.index, frame.ids[seen], frame.status[seen]
    rows["position"] = frame.positions[seen]
    rows["sigma"] = np.sqrt(np.diagonal(frame.covariances[seen], axis1=1, axis2=2))
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


def trajectories_of(rows: Rows, frames: Integers, times: NDArray[np.float64]) -> PointTrajectories:
    """Trajectories in space, or in the image where there is one view alone.

    Args:
        rows: sightings.
        frames: (T,) all frame numbers, also of frames without a sighting.
        times: (T,) seconds.
    """
    flat = rows["pixels"].shape[1] == 1
    ids = np.unique(rows["id"])
    shape = len(frames), len(ids), 2 if flat else 3
    positions, sigmas = np.full(shape, np.nan), np.full(shape, np.nan)
    status = np.full(shape[:2], int(PointStatus.HIDDEN))
    t, n = np.searchsorted(frames, rows["frame"]), np.searchsorted(ids, rows["id"])
    positions[t, n] = rows["pixels"][:, 0] if flat else rows["position"]
    sigmas[t, n] = rows["sigmas_px"][:, 0] if flat else rows["sigma"]
    status[t, n] = rows["status"]
    return PointTrajectories(frames, times, ids.astype(np.int64), positions, sigmas, status)
