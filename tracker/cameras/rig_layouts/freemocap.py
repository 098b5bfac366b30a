"""Calibrations of FreeMoCap."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import Listing
from tracker.cameras.rig_layouts._cameras import toml_program
from tracker.cameras.rig_layouts._plausible import up_remarks
from tracker.cameras.rig_layouts._sources import toml_table
from tracker.cameras.rig_layouts.anipose import AniposeLayout
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import CalibrationError


@component
class FreeMoCapLayout:
    """`NAME_camera_calibration.toml`: Anipose's tables with FreeMoCap's metadata, in millimetres.

    FreeMoCap counts in the unit of `charuco_square_size`, from version 2 on of `square_length_mm`, for which it asks in
    millimetres; left at 1, lengths are squares of the board, and the file is refused. Unless `groundplane_calibration`,
    from version 2 on `groundplane_applied`, is true the world is that of the first camera; else z is up from the board
    on the floor.
    """

    endings: ClassVar[tuple[str, ...]] = (".toml",)
    shape: ClassVar[str] = "FreeMoCap's NAME_camera_calibration.toml"
    terms: ClassVar[int] = 8

    def detects(self, path: Path) -> bool:
        """A TOML file with FreeMoCap's metadata."""
        return toml_program(path) == "freemocap"

    def read(self, path: Path, size: tuple[int, int] | None) -> Listing:
        """Reads the tables."""
        metadata = toml_table(path).get("metadata", {})
        listing = AniposeLayout().read(path, size)
        no_unit = ""
        if "units" not in metadata:
            board = metadata.get("board")
            told = {**metadata, **(board if isinstance(board, dict) else {})}
            key = next((key for key in ("charuco_square_size", "square_length_mm") if told.get(key) == 1), "")
            if key:
                no_unit = (
                    f"{key} = 1: lengths are squares of the board, expected the side of a square in mm: tell it to "
                    "FreeMoCap and calibrate again"
                )
            listing = replace(listing, unit="mm")
        remarks = *listing.remarks, *(up_remarks(listing.cameras) or _floor_remarks(metadata))
        return replace(listing, remarks=remarks, no_unit=no_unit)

    def contents(self, rig: Rig) -> dict[str, bytes]:
        """Nothing: FreeMoCap's metadata describe a board that is not known here."""
        raise CalibrationError("FreeMoCap's calibrations are read only: choose the layout anipose")


def _floor_remarks(metadata: dict[str, Any]) -> tuple[str, ...]:
    """Warning if z is up only by chance, as the cameras stand, because no board lay on the floor."""
    if True in (metadata.get("groundplane_calibration"), metadata.get("groundplane_applied")):
        return ()
    if "groundplane_calibration" not in metadata and "groundplane_applied" not in metadata:
        return ()
    return (
        "FreeMoCap had no ground plane: the origin is that of a camera, not of the floor: `bodytrack rig convert THIS "
        "rig.toml --floor METRES` tells where the floor lies along z",
    )
