"""Files of marker systems; one reader for whoever needs them."""

from __future__ import annotations

from pathlib import Path

from tracker.errors import SequenceError
from tracker.marker_layouts.c3d import read_c3d
from tracker.marker_layouts.trc import read_trc
from tracker.markers import Markers

_READERS = {".trc": read_trc, ".c3d": read_c3d}


def read_markers(path: Path) -> Markers:
    """Reads a recording of markers.

    Args:
        path: `.trc`, or `.c3d` with the extra `export` installed.

    Raises:
        SequenceError: the file is missing, damaged, or of another kind.
        ConfigError: it is a C3D, and the package c3d is not installed.
    """
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise SequenceError(f"{path}: expected a file of markers, .trc or .c3d")
    if not path.is_file():
        raise SequenceError(f"{path}: no such file of markers")
    return reader(path)
