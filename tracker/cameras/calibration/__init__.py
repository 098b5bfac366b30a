"""Calibration: from images of a bar, a board or measured points to a rig, with its uncertainty."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from tracker.cameras.calibration._calibrated import Calibrated, Measure
from tracker.cameras.calibration._floor_marks import Mark, floor_marks
from tracker.cameras.calibration._report import report_html, report_text
from tracker.cameras.calibration._world import read_points
from tracker.cameras.frame import Views
from tracker.foundation.progress import Progress

__all__ = [
    "Calibrated",
    "Calibration",
    "Mark",
    "Measure",
    "Views",
    "floor_marks",
    "read_points",
    "report_html",
    "report_text",
]


@runtime_checkable
class Calibration(Protocol):
    """A component that calibrates cameras from their images."""

    def calibrate(self, views: Views, progress: Progress) -> Calibrated:
        """Measures the images and adjusts the rig.

        Args:
            views: the images.
            progress: told how far it is.

        Raises:
            CalibrationError: the images do not show what is needed, or do not fit together.
        """
        ...
