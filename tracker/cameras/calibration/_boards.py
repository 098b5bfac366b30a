"""Chessboards and ChArUco boards in images; detection is OpenCV's."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from tracker.foundation.arrays import Array, Array32, Image, Integers
from tracker.foundation.errors import CalibrationError, nearest

DICTIONARIES = {name[5:].lower(): getattr(cv2.aruco, name) for name in dir(cv2.aruco) if name.startswith("DICT_")}
"""OpenCV's dictionaries of markers, by the names that a configuration has for them."""

_SADDLE = 0.5
"""Share of a board's contrast by which the squares around an inner corner differ at least, and do not at most."""
_BESIDE, _BEYOND = 0.35, 0.8
"""Squares from a corner to where its squares are looked at; share of a line's corners that go on behind a board."""


@dataclass(frozen=True)
class Pattern:
    """How a board looks: a chessboard of so many inner corners, or a ChArUco board of so many squares."""

    columns: int
    rows: int
    marker: float | None = None
    """Side of a marker, in squares; None for a plain chessboard."""

    dictionary: str = ""
    """Of the markers, for instance `4x4_50`."""

    legacy: bool = False
    """ChArUco: whether it begins with a white square where the number of rows is even, as of OpenCV before 4.6."""

    inverted: bool = False
    """Whether it is white on black."""

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows."""
        return self.columns, self.rows

    @property
    def plan(self) -> Array:
        """(N, 3) all its inner corners, row by row, in squares."""
        inside = 0 if self.marker is None else 1
        columns, rows = np.meshgrid(np.arange(self.columns - inside), np.arange(self.rows - inside))
        return np.stack([columns, rows, 0 * rows], axis=-1).reshape(-1, 3) + float(inside) * np.array([1.0, 1.0, 0.0])


def plain_grey(image: Image) -> Image:
    """(h, w) grey levels."""
    grey: Image = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return grey


def find_board(image: Image, pattern: Pattern) -> tuple[Integers, Array]:
    """Numbers (N,) in the pattern's plan and pixels (N, 2) of the corners that an image shows.

    Raises:
        CalibrationError: no such dictionary of markers, or too small a one.
    """
    shown = 255 - image if pattern.inverted else image
    if pattern.marker is not None:
        return find_charuco(shown, charuco_detector(pattern))
    corners = find_corners(shown, pattern.size)
    return (np.zeros(0, dtype=np.int64), np.zeros((0, 2))) if corners is None else (np.arange(len(corners)), corners)


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


def goes_on(image: Image, corners: Array, size: tuple[int, int]) -> bool:
    """Whether a chessboard has more inner corners than the (N, 2) found: those of a part of it tell wrong places."""
    grey = plain_grey(image).astype(np.float32)
    columns, rows = size
    plan = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2).astype(np.float64)
    matrix = cv2.findHomography(plan, corners)[0]
    if matrix is None:
        return False
    contrast = float(np.median(np.ptp(_around(grey, matrix, plan), axis=1)))
    along_rows, along_columns = np.arange(rows), np.arange(columns)
    beyond = [np.column_stack([np.full(rows, k), along_rows]) for k in (-1, columns)]
    beyond += [np.column_stack([along_columns, np.full(columns, k)]) for k in (-1, rows)]
    for line in beyond:
        a, b, c, d = _around(grey, matrix, line.astype(np.float64)).T
        apart, alike = np.abs(a + c - b - d) / 2, np.maximum(np.abs(a - c), np.abs(b - d))
        if np.mean((apart > _SADDLE * contrast) & (alike < _SADDLE * contrast)) > _BEYOND:
            return True
    return False


def _around(grey: Array32, matrix: Array, places: Array) -> Array:
    """(N, 4) grey levels of the four squares around places (N, 2) of a plan, one after another; NaN outside."""
    steps = _BESIDE * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    pixels = cv2.perspectiveTransform((places[:, None] + steps).reshape(1, -1, 2), matrix)[0].astype(np.float32)
    levels = cv2.remap(grey, pixels[:, 0], pixels[:, 1], cv2.INTER_LINEAR, borderValue=np.nan)
    return np.asarray(levels, dtype=np.float64).reshape(-1, 4)


@functools.lru_cache(maxsize=64)
def charuco_detector(pattern: Pattern) -> cv2.aruco.CharucoDetector:
    """OpenCV's detector of a ChArUco board.

    Raises:
        CalibrationError: no such dictionary of markers, or too small a one.
    """
    markers = markers_of(pattern.dictionary)
    needed, there = n_markers(pattern), len(markers.bytesList)
    if needed > there:
        raise CalibrationError(
            f"a board of {pattern.columns} x {pattern.rows} squares has {needed} markers, and dictionary = "
            f'"{pattern.dictionary}" has {there}; {_larger(pattern.dictionary, needed)}'
        )
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)  # it has a word on markers with a narrow rim
    try:
        board = cv2.aruco.CharucoBoard(pattern.size, 1.0, pattern.marker or 0.0, markers)
    finally:
        cv2.utils.logging.setLogLevel(level)
    board.setLegacyPattern(pattern.legacy)
    return cv2.aruco.CharucoDetector(board)


def markers_of(dictionary: str) -> Any:
    """OpenCV's dictionary of a name.

    Raises:
        CalibrationError: there is none.
    """
    key = dictionary.lower().removeprefix("dict_")
    if key not in DICTIONARIES:
        raise CalibrationError(f'dictionary = "{dictionary}"; {nearest(key, DICTIONARIES)}')
    return cv2.aruco.getPredefinedDictionary(DICTIONARIES[key])


def n_markers(pattern: Pattern) -> int:
    """Markers of a ChArUco board: on every second square."""
    return pattern.columns * pattern.rows // 2


@functools.cache
def families() -> dict[str, list[str]]:
    """Dictionaries that share their first markers, the smallest first; by what their names begin with."""
    found: dict[str, list[str]] = {}
    for name in DICTIONARIES:
        start, _, number = name.rpartition("_")
        found.setdefault(start if number.isdigit() else name, []).append(name)
    return {family: sorted(names, key=lambda name: len(markers_of(name).bytesList)) for family, names in found.items()}


def smallest(family: list[str], needed: int) -> str | None:
    """The first of some dictionaries, the smallest first, that has so many markers; None if none has."""
    return next((name for name in family if len(markers_of(name).bytesList) >= needed), None)


def _larger(dictionary: str, needed: int) -> str:
    key = dictionary.lower().removeprefix("dict_")
    fitting = smallest(next(names for names in families().values() if key in names), needed)
    return f'dictionary = "{fitting}" begins with the same' if fitting else "are columns and rows right?"


def find_charuco(image: Image, detector: cv2.aruco.CharucoDetector) -> tuple[Integers, Array]:
    """Numbers (N,) and pixels (N, 2) of the seen corners of a ChArUco board."""
    corners, numbers, _, _ = detector.detectBoard(plain_grey(image))
    if corners is None or numbers is None:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 2))
    return numbers.ravel().astype(np.int64), np.asarray(corners, dtype=np.float64).reshape(-1, 2)
