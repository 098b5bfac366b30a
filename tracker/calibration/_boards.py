"""Chessboards and ChArUco boards in images; detection is OpenCV's."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.arrays import Array, Image, Integers
from tracker.errors import CalibrationError, nearest

_DICTIONARIES = {name[5:].lower(): getattr(cv2.aruco, name) for name in dir(cv2.aruco) if name.startswith("DICT_")}


def plain_grey(image: Image) -> Image:
    """(h, w) grey levels."""
    grey: Image = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return grey


def find_corners(image: Image, size: tuple[int, int]) -> Array | None:
    """Inner corners of a chessboard.

    Args:
        image: grey or colour.
        size: inner corners along a row, and rows.

    Returns:
        (columns * rows, 2) px, row by row; None where the board is not seen as a whole.
    """
    grey = plain_grey(image)
    found, corners = cv2.findChessboardCorners(
        grey, size, flags=cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    )
    if not found:
        return None
    spacing = np.linalg.norm(np.diff(corners.reshape(size[1], size[0], 2), axis=1), axis=2).min()
    half = int(np.clip(spacing / 3, 2, 11))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
    refined = cv2.cornerSubPix(grey, corners, (half, half), (-1, -1), criteria)
    return np.asarray(refined.reshape(-1, 2), dtype=np.float64)


def charuco_detector(
    size: tuple[int, int], square_m: float, marker_m: float, dictionary: str
) -> cv2.aruco.CharucoDetector:
    """OpenCV's detector of a board of so many squares.

    Raises:
        CalibrationError: no such dictionary of markers.
    """
    key = dictionary.lower().removeprefix("dict_")
    if key not in _DICTIONARIES:
        raise CalibrationError(f'dictionary = "{dictionary}"; {nearest(key, _DICTIONARIES)}')
    markers = cv2.aruco.getPredefinedDictionary(_DICTIONARIES[key])
    return cv2.aruco.CharucoDetector(cv2.aruco.CharucoBoard(size, square_m, marker_m, markers))


def find_charuco(image: Image, detector: cv2.aruco.CharucoDetector) -> tuple[Integers, Array]:
    """Numbers (N,) and pixels (N, 2) of the seen corners of a ChArUco board."""
    corners, numbers, _, _ = detector.detectBoard(plain_grey(image))
    if corners is None or numbers is None:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 2))
    return numbers.ravel().astype(np.int64), np.asarray(corners, dtype=np.float64).reshape(-1, 2)
