"""C3D, the binary format of biomechanics; needs the extra `export`."""

from __future__ import annotations

import importlib
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from tracker.arrays import Array32
from tracker.errors import ConfigError, SequenceError, nearest, shortened
from tracker.markers import METRES_PER_UNIT, Markers, without_gaps
from tracker.source_files import one_line

_MARK = 0x50
"""Second byte of every C3D file."""


def read_c3d(path: Path) -> Markers:
    """Reads a C3D file; a negative residual, NaN or a position of zeros is a gap. Time begins with its first frame.

    Raises:
        SequenceError: the file is damaged, or its unit is unknown.
        ConfigError: the package c3d is not installed.
    """
    reading = _library().Reader
    with path.open("rb") as file:
        if file.read(2)[1:] != bytes([_MARK]):
            raise SequenceError(f"{path}: not a C3D file")
        file.seek(0)
        try:
            with warnings.catch_warnings():  # of what is missing, which is looked at here
                warnings.simplefilter("ignore")
                unit, rate, names, first, frames = _content(reading(file))
        except Exception as error:  # it is written in Python, and raises whatever a damaged file leads to
            told = one_line(error) if isinstance(error, SequenceError) else f"{type(error).__name__}: {one_line(error)}"
            raise SequenceError(f"{path}: damaged, or no C3D file: {told}") from error
    points, residuals = frames[..., :3].astype(np.float64), frames[..., 3]
    if unit not in METRES_PER_UNIT:
        raise SequenceError(f'{path}: POINT:UNITS is "{shortened(unit)}"; {nearest(unit, METRES_PER_UNIT)}')
    if not 0 < rate < np.inf or len(points) < 2 or len(names) < points.shape[1]:
        raise SequenceError(f"{path}: {len(points)} frames at {rate:g} Hz with {len(names)} names, cannot be")
    seen = np.where((residuals < 0)[..., None], np.nan, points)
    times_s = (first + np.arange(len(points))) / rate
    return Markers(names[: points.shape[1]], times_s, METRES_PER_UNIT[unit] * without_gaps(seen))


def _content(reader: Any) -> tuple[str, float, tuple[str, ...], int, Array32]:
    """Unit, rate, names, number of the first frame from 0 on, and all frames (T, M, 5): x, y, z, residual, cameras."""
    unit = reader.get("POINT:UNITS").string_value.strip().lower()
    names = tuple(label.strip() for label in _labels(reader))
    wanted = reader.last_frame - reader.first_frame + 1
    if reader.point_used < 1:
        raise SequenceError("no markers in it")
    frames = [points for _, points, _ in reader.read_frames()]
    if len(frames) != wanted:
        raise SequenceError(f"{len(frames)} of {wanted} frames are there")
    return unit, float(reader.point_rate), names, int(reader.first_frame) - 1, np.array(frames, dtype=np.float32)


def _labels(reader: Any) -> list[str]:
    """Names of all markers: a parameter holds 255 of them, the rest is in LABELS2, LABELS3 and so on."""
    labels, further = list(reader.point_labels), 2
    while len(labels) < reader.point_used and (more := reader.get(f"POINT:LABELS{further}")) is not None:
        labels += list(more.string_array)
        further += 1
    return labels


def _library() -> Any:
    """The reader in Python: ezc3d, which writes, ends the process with one damaged file in a hundred."""
    try:
        return importlib.import_module("c3d")
    except ImportError as error:
        raise ConfigError('reading C3D files needs the Python package c3d: pip install "bodytrack[export]"') from error
