"""Calibrations of FreeMoCap."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from tracker.components import component
from tracker.errors import CalibrationError
from tracker.rig import Rig
from tracker.rig_layouts import Listing
from tracker.rig_layouts._cameras import in_metres
from tracker.rig_layouts._sources import toml_table
from tracker.rig_layouts._toml_tables import is_freemocap
from tracker.rig_layouts._up import up_remarks
from tracker.rig_layouts.anipose import AniposeLayout
from tracker.rig_layouts.caliscope import is_caliscope


@component
class FreeMoCapLayout:
    """`NAME_camera_calibration.toml`: Anipose's tables with FreeMoCap's metadata, in millimetres.

    FreeMoCap counts in the unit of `charuco_square_size`, which it asks for in millimetres; left at 1, lengths are
    squares of the board, and the file is refused. Unless `groundplane_calibration` is true the world is that of the
    first camera.
    """

    endings: ClassVar[tuple[str, ...]] = (".toml",)
    shape: ClassVar[str] = "FreeMoCap's NAME_camera_calibration.toml"

    def detects(self, path: Path) -> bool:
        """A TOML file with FreeMoCap's metadata."""
        return path.suffix.lower() == ".toml" and path.is_file() and is_freemocap(path) and not is_caliscope(path)

    def read(self, path: Path, size: tuple[int, int] | None) -> Listing:
        """Reads the tables."""
        metadata = toml_table(path).get("metadata", {})
        listing = AniposeLayout().read(path, size)
        if "units" not in metadata:
            if metadata.get("charuco_square_size") == 1:
                raise CalibrationError(
                    "charuco_square_size = 1: lengths are squares of the board, expected the side of a square in mm: "
                    "tell it to FreeMoCap and calibrate again"
                )
            listing = replace(listing, cameras=tuple(in_metres(one, {"units": "mm"}) for one in listing.cameras))
        return replace(listing, remarks=up_remarks(listing.cameras))

    def contents(self, rig: Rig) -> dict[str, bytes]:
        """Nothing: FreeMoCap's metadata tell of a board that is not known here."""
        raise CalibrationError("FreeMoCap's calibrations are read only: choose the layout anipose")
