"""Calibration: from images of a bar, a board or measured points to a rig, with its uncertainty."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from tracker.calibration._calibrated import Calibrated, Measure
from tracker.calibration._report import report_html, report_text
from tracker.calibration._views import Told, Views
from tracker.calibration._world import read_points

__all__ = ["Calibrated", "Calibration", "Measure", "Told", "Views", "read_points", "report_html", "report_text"]


@runtime_checkable
class Calibration(Protocol):
    """A component that calibrates cameras from their images."""

    def calibrate(self, views: Views, told: Told) -> Calibrated:
        """Measures the images and adjusts the rig.

        Args:
            views: the images.
            told: told of the progress.

        Raises:
            CalibrationError: the images do not show what is needed, or do not fit together.
        """
        ...
