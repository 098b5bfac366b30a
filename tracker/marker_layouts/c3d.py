"""C3D, the binary format of biomechanics; needs the extra `export`."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np

from tracker.errors import ConfigError, SequenceError, nearest, shortened
from tracker.markers import METRES_PER_UNIT, Markers, without_gaps
from tracker.source_files import one_line

_MARK = 0x50
"""Second byte of every C3D file."""


def read_c3d(path: Path) -> Markers:
    """Reads a C3D file; a negative residual, NaN or a position of zeros is a gap. Time begins with its first frame.

    Raises:
        SequenceError: the file is damaged, or its unit is unknown.
        ConfigError: ezc3d is not installed.
    """
    library = _library()
    with path.open("rb") as file:
        if file.read(2)[1:] != bytes([_MARK]):
            raise SequenceError(f"{path}: not a C3D file")
    try:
        content = library.c3d(str(path))
        point = content["parameters"]["POINT"]
        unit, rate = str(point["UNITS"]["value"][0]).strip().lower(), float(point["RATE"]["value"][0])
        names = tuple(str(label).strip() for label in point["LABELS"]["value"])
        points = content["data"]["points"][:3].transpose(2, 1, 0)
        residuals = content["data"]["meta_points"]["residuals"][0].T
        first = int(content["header"]["points"]["first_frame"])
    except (OSError, RuntimeError, ValueError, KeyError, IndexError, TypeError, MemoryError) as error:
        raise SequenceError(f"{path}: damaged, or no C3D file: {one_line(error)}") from error
    if unit not in METRES_PER_UNIT:
        raise SequenceError(f'{path}: POINT:UNITS is "{shortened(unit)}"; {nearest(unit, METRES_PER_UNIT)}')
    if not 0 < rate < np.inf or len(points) < 2 or len(names) < points.shape[1]:
        raise SequenceError(f"{path}: {len(points)} frames at {rate:g} Hz with {len(names)} names, cannot be")
    seen = np.where((residuals < 0)[..., None], np.nan, points)
    times_s = (first + np.arange(len(points))) / rate
    return Markers(names[: points.shape[1]], times_s, METRES_PER_UNIT[unit] * without_gaps(seen))


def _library() -> Any:
    try:
        return importlib.import_module("ezc3d")
    except ImportError as error:
        raise ConfigError('C3D files need the Python package ezc3d: pip install "bodytrack[export]"') from error
