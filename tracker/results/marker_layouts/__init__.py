"""Files of marker systems, recognized by their content; one reader for all."""

from __future__ import annotations

from pathlib import Path

from tracker.foundation.errors import SequenceError, os_fault
from tracker.results.marker_layouts.c3d import is_c3d, read_c3d
from tracker.results.marker_layouts.trc import read_trc
from tracker.results.markers import Markers, check_size

_HEAD_BYTES = 2000
"""Bytes that identify a file; OpenSim's tables end their header within them."""

_OTHERS = {
    "no_of_frames": "a TSV export of Qualisys Track Manager",
    "file_version": "a TSV export of Qualisys Track Manager",
    "format version,": "a CSV export of OptiTrack Motive",
    "trajectories": "a CSV export of Vicon Nexus",
    "hierarchy": "a BVH file, a skeleton that moves",
    "<?xml": "an XML file",
}
"""First bytes of other motion files."""


def read_markers(path: Path, unit: str | None = None) -> Markers:
    """Reads a recording of markers, TRC or C3D.

    Args:
        path: of the file.
        unit: of its lengths, m, dm, cm, mm, in or ft; None for the file's own.

    Raises:
        SequenceError: the file is missing, damaged, of another kind, or in another unit than it says.
    """
    if not path.is_file():
        raise SequenceError(f"{path}: no such file of markers")
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError as error:
        raise SequenceError(os_fault(error)) from error
    if is_c3d(head):
        return _checked(path, read_c3d(path, unit))
    text = head.replace(b"\0", b"").decode("latin-1").lstrip("\xef\xbb\xbf\xfe\xff ").lower()
    if text.startswith("pathfiletype"):
        return _checked(path, read_trc(path, unit))
    other = next((name for sign, name in _OTHERS.items() if text.startswith(sign)), None)
    if other is None and "endheader" in text:
        other = "a table of OpenSim (.mot, .sto)"
    raise SequenceError(f"{path}: {other or 'not a file of markers'}, expected TRC or C3D: export it as such")


def _checked(path: Path, recording: Markers) -> Markers:
    check_size(path, recording)
    return recording
