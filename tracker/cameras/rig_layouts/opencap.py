"""The calibration of an OpenCap session."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import Listing
from tracker.cameras.rig_layouts._cameras import Entry, listing_of
from tracker.cameras.rig_layouts._pickled import pickled_table
from tracker.cameras.rig_layouts._units import up_remarks
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import CalibrationError, os_fault

_FILE = "cameraIntrinsicsExtrinsics.pickle"
_KEYS = "intrinsicMat", "distortion", "rotation", "translation"
_LARGEST_BYTES = 2**16
"""Of a file: a camera takes 1 kB."""


@component
class OpenCapLayout:
    """A session's folder with `Videos/CAMERA/cameraIntrinsicsExtrinsics.pickle`; millimetres, the board's axes.

    OpenCap stores calibrations as pickles only. They are read as data, by a reader that knows numbers and arrays and
    nothing else; Python's, which runs what such a file asks for, is not used.
    """

    endings: ClassVar[tuple[str, ...]] = ()
    shape: ClassVar[str] = f"an OpenCap session (Videos/CAMERA/{_FILE})"
    terms: ClassVar[int] = 8

    def detects(self, path: Path) -> bool:
        """The session, its folder of videos, or one of its files."""
        return bool(_files(path))

    def read(self, path: Path, size: tuple[int, int] | None) -> Listing:
        """Reads the cameras, called as their folders; one that was only calibrated by itself is left out."""
        entries = []
        for file in _files(path):
            name = file.parent.name
            try:
                table = pickled_table(_content(file))
            except CalibrationError as error:
                raise CalibrationError(f'camera "{name}": {_FILE}: {error}') from error
            entries.append(Entry(name, _with_size(table), *_KEYS))
        listing = listing_of(entries, "mm", no_pose="has no pose: the board was not found in its images")
        return replace(listing, remarks=(*listing.remarks, *up_remarks(listing.cameras)))

    def contents(self, rig: Rig) -> dict[str, bytes]:
        """Nothing: OpenCap takes pickles, which are not written either."""
        raise CalibrationError("OpenCap's calibrations are read only: choose another layout")


def _files(path: Path) -> list[Path]:
    if path.name == _FILE and path.is_file():
        path = path.parent.parent
    if not path.is_dir():
        return []
    return sorted(path.glob(f"*/{_FILE}")) or sorted(path.glob(f"Videos/*/{_FILE}"))


def _content(file: Path) -> bytes:
    try:
        with file.open("rb") as opened:
            content = opened.read(_LARGEST_BYTES + 1)
    except OSError as error:
        raise CalibrationError(os_fault(error)) from error
    if len(content) > _LARGEST_BYTES:
        raise CalibrationError("larger than 64 kB, expected one camera")
    return content


def _with_size(table: dict[str, Any]) -> dict[str, Any]:
    """The table with `size` as width and height: OpenCap's `imageSize` is height and width."""
    size = table.get("imageSize")
    return table if size is None else {**table, "size": size.ravel()[::-1] if hasattr(size, "ravel") else size}
