"""Trajectories read from the tables that a following writes, or that another program has written like them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tracker.foundation.arrays import Array, Integers, Mask, frozen
from tracker.foundation.errors import SequenceError, nearest
from tracker.foundation.source_files import cells_of, check_commas, one_line

TABLE = "trajectories.csv"
"""The table in a result folder of `bodytrack follow`."""

_LEAST_SIGMA_PX, _LEAST_SIGMA_M = 0.05, 0.0001
"""A point is no better known than this: in 2-D mode the sigma at its birth is 0, for there it is what it is."""

_FARTHEST_FRAME = 10**9
"""A year at 30 frames a second."""

_MOST_CELLS, _FULLEST = 10**7, 0.1
"""Frames times points beyond which a table is refused of whose frames fewer than this share are there at all: what is
numbered so is no frame, but a time."""

Words = NDArray[np.str_]


@dataclass(frozen=True)
class PointTable:
    """N points over T frames, as far as a table tells."""

    frames: Integers
    """(T,) frame numbers, consecutive."""

    times: Array
    """(T,) seconds."""

    ids: Integers
    """(N,) the numbers of the points; places in the alphabet where they have names."""

    positions: Array
    """(T, N, D) metres in space, or px in the image of one view; NaN where a point is not seen."""

    covariances: Array
    """(T, N, D, D) of the positions."""

    @property
    def seen(self) -> Mask:
        """(T, N) where a point has a position."""
        seen: Mask = np.isfinite(self.positions[..., 0])
        return seen

    @property
    def flat(self) -> bool:
        """Whether the points lie in the image of one view."""
        return bool(self.positions.shape[2] == 2)


def read_trajectories(path: Path) -> PointTable:
    """Reads `trajectories.csv`: `frame, time_s, point`, then place and sigmas in m, or in px of one view.

    Args:
        path: the table, or the result folder that it lies in.

    Raises:
        SequenceError: there is none, or not what it should be.
    """
    table = path / TABLE if path.is_dir() else path
    if not table.is_file():
        beside = [one.name for one in table.parent.glob("*.csv")] if table.parent.is_dir() else []
        raise SequenceError(f"{table}: no such table of followed points; {nearest(table.name, beside)}")
    head, *rows = cells_of(table, SequenceError) or [[]]
    if not rows:
        raise SequenceError(f"{table}: the table is empty")
    check_commas(head, table, SequenceError)
    for n, row in enumerate(rows, start=1):
        if len(row) != len(head):
            raise SequenceError(f"{table}: {len(row)} cells in row {n}, expected {len(head)}, one a column")
    return _arranged(head, rows, table)


def _arranged(head: list[str], rows: list[list[str]], path: Path) -> PointTable:
    """Arrays (T, N, ...) of rows in any order; frames between the first and the last are all there."""
    unit, axes, least = ("px", "xy", _LEAST_SIGMA_PX) if "x_px" in head else ("m", "xyz", _LEAST_SIGMA_M)
    n_axes = len(axes)
    numbers = _numbers(head, rows, ("frame", "time_s"), path)
    places = _numbers(head, rows, [f"{axis}_{unit}" for axis in axes], path)
    sigmas = _numbers(head, rows, [f"sigma_{axis}_{unit}" for axis in axes], path)
    if (sigmas < 0).any():
        bad = int(np.flatnonzero((sigmas < 0).any(axis=1))[0]) + 1
        raise SequenceError(f"{path}: row {bad} has a negative sigma, expected standard deviations in {unit}")
    spread = np.maximum(sigmas, least)[:, :, None] ** 2 * np.eye(n_axes)
    if {"cov_xy_m2", "cov_xz_m2", "cov_yz_m2"} <= set(head):
        i, j = np.triu_indices(n_axes, 1)
        spread[:, i, j] = spread[:, j, i] = _numbers(head, rows, ("cov_xy_m2", "cov_xz_m2", "cov_yz_m2"), path)
    labels: Words = np.array([row[_column(head, "point", path)] for row in rows])
    # 19 digits are more than a number holds, and there are digits that are none: ²
    numbered = bool((np.char.isdecimal(labels) & (np.char.str_len(labels) < 19)).all())
    names, n = np.unique(labels.astype(np.int64) if numbered else labels, return_inverse=True)
    whole = _whole(numbers[:, 0], path)
    known, first = np.unique(whole, return_index=True)
    n_frames = int(known[-1] - known[0]) + 1
    if n_frames * len(names) > _MOST_CELLS and len(known) < _FULLEST * n_frames:
        raise SequenceError(
            f'{path}: "frame" is {known[0]} to {known[-1]} in a table of {len(known)} frames, expected their numbers '
            "in the recording"
        )
    pairs, n_rows = np.unique(np.stack([whole, n]), axis=1, return_counts=True)
    if n_rows.max() > 1:
        frame, point = pairs[:, n_rows.argmax()]
        raise SequenceError(f"{path}: point {names[point]} is there twice in frame {frame}, expected once")
    frames = np.arange(known[0], known[-1] + 1)
    positions = np.full((len(frames), len(names), n_axes), np.nan)
    covariances = np.full((len(frames), len(names), n_axes, n_axes), np.nan)
    positions[whole - frames[0], n], covariances[whole - frames[0], n] = places, spread
    ids = names.astype(np.int64) if numbered else np.arange(len(names), dtype=np.int64)
    times = np.interp(frames, known, numbers[first, 1])
    return PointTable(frames, frozen(times), ids, frozen(positions), frozen(covariances))


def _whole(values: Array, path: Path) -> Integers:
    """The numbers of frames."""
    bad = (values != np.floor(values)) | (np.abs(values) > _FARTHEST_FRAME)
    if bad.any():
        raise SequenceError(f'{path}: "frame" is {values[bad][0]:.15g}, expected a whole number')
    return values.astype(np.int64)


def _column(head: list[str], name: str, path: Path) -> int:
    if name not in head:
        raise SequenceError(f'{path}: no column "{name}"; {nearest(name, head)}')
    if head.count(name) > 1:
        raise SequenceError(f'{path}: {head.count(name)} columns are called "{name}", expected one')
    return head.index(name)


def _numbers(head: list[str], rows: list[list[str]], names: list[str] | tuple[str, ...], path: Path) -> Array:
    """(rows, names) finite numbers."""
    columns = [_column(head, name, path) for name in names]
    try:
        values = np.array([[float(row[k]) for k in columns] for row in rows])
    except ValueError as error:
        raise SequenceError(f"{path}: {one_line(error)}") from error
    bad = ~np.isfinite(values).all(axis=1)
    if bad.any():
        n = int(np.flatnonzero(bad)[0]) + 1
        raise SequenceError(f"{path}: row {n} has a value that is not finite; leave rows of hidden points out")
    return values
