"""Calibrations for Pose2Sim."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import Listing
from tracker.cameras.rig_layouts.anipose import AniposeLayout, tables_of
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import CalibrationError


@component
class Pose2SimLayout:
    """`Calib.toml`: Anipose's tables with the four distortion coefficients k1 k2 p1 p2."""

    endings: ClassVar[tuple[str, ...]] = (".toml",)
    shape: ClassVar[str] = "Pose2Sim's Calib.toml"
    terms: ClassVar[int] = 4

    def detects(self, path: Path) -> bool:
        """Never: what Pose2Sim writes are Anipose's tables, and read as such."""
        return False

    def read(self, path: Path, size: tuple[int, int] | None) -> Listing:
        """Reads Anipose's tables."""
        return AniposeLayout().read(path, size)

    def contents(self, rig: Rig) -> dict[str, bytes]:
        """Anipose's tables without k3; the lenses have been fitted to four terms."""
        lost = [camera.name for camera in rig.cameras if camera.distortion[4:].any()]
        if lost:
            raise CalibrationError(
                f"{', '.join(lost)}: of k3, k4, k5 and k6 one is not 0, which the four distortion coefficients of "
                "Pose2Sim cannot hold: choose another layout"
            )
        return {"": tables_of(rig, n_distortion=4)}
