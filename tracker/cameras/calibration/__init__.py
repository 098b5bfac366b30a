"""Calibration: from images of a bar, a board or measured points to a rig, with its uncertainty."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from tracker.cameras.calibration._adjustment import Calibrated, Measure
from tracker.cameras.calibration._board_looks import FoundBoard, found_board
from tracker.cameras.calibration._board_print import BoardPrint, board_pattern, largest_square_mm, write_board
from tracker.cameras.calibration._floor_marks import Mark, floor_marks
from tracker.cameras.calibration._report import report_html, report_text
from tracker.cameras.calibration._world import read_points
from tracker.cameras.frame import Views
from tracker.foundation.progress import Progress

__all__ = [
    "BoardPrint",
    "Calibrated",
    "Calibration",
    "FoundBoard",
    "Mark",
    "Measure",
    "Views",
    "board_pattern",
    "floor_marks",
    "found_board",
    "largest_square_mm",
    "read_points",
    "report_html",
    "report_text",
    "write_board",
]


@runtime_checkable
class Calibration(Protocol):
    """A component that calibrates cameras from their images."""

    def calibrate(self, views: Views, progress: Progress) -> Calibrated:
        """Measures the images and adjusts the rig.

        Args:
            views: the images.
            progress: gets the progress.

        Raises:
            CalibrationError: the images do not show what is needed, or do not fit together.
        """
        ...
