"""The record of a following: every sighting in one growing file, read again as trajectories, in windows of frames."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.foundation.arrays import Array, Integers, Mask
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


# A record of any length, looked at in windows of frames, so that memory does not grow with it.

MOST_SIGHTINGS = 150_000
"""Sightings that are held at a time: as trajectories with all that is computed of them about 0.5 GB."""

# Shorter windows would be margins above all.
_LEAST_WINDOW = 32


@dataclass(frozen=True)
class Window:
    """Some frames of a record."""

    trajectories: PointTrajectories
    """Of these frames and of some before and after."""

    inner: slice
    """These frames among them."""


def windows(
    rows: Rows,
    frames: Integers,
    times: Array,
    margin: int,
    changed: Callable[[Rows], Rows] = lambda rows: rows,
    most_sightings: int = MOST_SIGHTINGS,
) -> Iterator[Window]:
    """Cuts a record into windows that follow one another.

    Args:
        rows: sightings in the order of the frames.
        frames: (T,) all frame numbers.
        times: (T,) seconds.
        margin: frames before and after that each window has, too.
        changed: what is done to the sightings first.
        most_sightings: held at a time, about.
    """
    n_frames = len(frames)
    size = max(_LEAST_WINDOW, int(most_sightings * n_frames / max(len(rows), 1)))
    for begin in range(0, n_frames, size):
        end = min(begin + size, n_frames)
        first, last = max(0, begin - margin), min(n_frames, end + margin)
        own = changed(between(rows, int(frames[first]), int(frames[last - 1]) + 1))
        trajectories = trajectories_of(own, frames[first:last], times[first:last])
        yield Window(trajectories, slice(begin - first, end - first))


# Velocities and accelerations of followed points, with their precision.

# A parabola through four has one redundant observation.
_LEAST_FRAMES = 4


REACH_FRAMES = 2
"""Frames before and after that take part in a fit."""


@dataclass(frozen=True)
class Motion:
    """How N points move in T frames; units are those of the positions, a second."""

    velocities: Array
    """(T, N, D); NaN where fewer than four frames around show the point."""

    accelerations: Array
    """(T, N, D)"""

    velocity_sigmas: Array
    """(T, N, D) from the sigmas of the positions, taken as independent: key patches are shared, so it is less."""

    acceleration_sigmas: Array
    """(T, N, D)"""


def motion_of(trajectories: PointTrajectories, reach: int = REACH_FRAMES) -> Motion:
    """Fits a parabola to the frames around each one.

    Args:
        trajectories: N points in T frames.
        reach: frames before and after that take part, where the point is seen in them without a gap; at the ends of
            the sequence more of the other side.

    Returns:
        First and second derivatives of the parabolas at their middle.
    """
    positions, times = trajectories.positions, trajectories.times
    n_frames = len(times)
    known = trajectories.seen, trajectories.sigmas**2
    parts = [_fitted(trajectories, *known, t, reach) for t in range(n_frames)]
    first, second, first_sigma, second_sigma = (np.stack([part[k] for part in parts]) for k in range(4))
    assert first.shape == positions.shape
    return Motion(first, second, first_sigma, second_sigma)


def _fitted(
    trajectories: PointTrajectories, all_seen: Mask, variances: Array, t: int, reach: int
) -> tuple[Array, Array, Array, Array]:
    """Velocities, accelerations and their sigmas (N, D) in one frame."""
    n_frames = len(trajectories.times)
    first = min(max(0, t - reach), max(0, n_frames - 2 * reach - 1))
    around = np.arange(first, min(n_frames, first + 2 * reach + 1))
    seen = all_seen[around]
    # A gap ends the window: what lies behind it may be another place of a movement that was not seen.
    middle = int(np.flatnonzero(around == t)[0])
    for k in range(middle + 1, len(around)):
        seen[k] &= seen[k - 1]
    for k in range(middle - 1, -1, -1):
        seen[k] &= seen[k + 1]
    elapsed = trajectories.times[around] - trajectories.times[t]
    scale = max(float(np.abs(elapsed).max(initial=0.0)), 1e-9)
    design = np.stack([np.ones_like(elapsed), elapsed / scale, (elapsed / scale) ** 2], axis=1)
    weight = seen.astype(np.float64)
    normal = np.einsum("ki,kj,kn->nij", design, design, weight)
    enough = weight.sum(axis=0) >= _LEAST_FRAMES
    normal[~enough] = np.eye(3)
    inverse = np.linalg.inv(normal)
    values = np.where(seen[..., None], trajectories.positions[around], 0.0)
    spread = np.where(seen[..., None], variances[around], 0.0)
    gains = np.einsum("nij,kj,kn->kni", inverse, design, weight)
    factors = np.array([1.0, 1 / scale, 2 / scale**2])
    found = np.einsum("kni,knd->ind", gains, values) * factors[:, None, None]
    sigmas = np.sqrt(np.einsum("kni,knd->ind", gains**2, spread)) * factors[:, None, None]
    found[:, ~enough], sigmas[:, ~enough] = np.nan, np.nan
    return found[1], found[2], sigmas[1], sigmas[2]
