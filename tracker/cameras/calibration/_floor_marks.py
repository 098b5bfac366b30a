"""Boards and markers that lie on the floor, as the views of a rig show them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tracker.cameras.calibration._board_looks import chessboards, markers_in
from tracker.cameras.calibration._boards import Pattern, families, find_board, plain_grey
from tracker.cameras.calibration._world import orders_alike
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image
from tracker.foundation.errors import CalibrationError

_MOST_OFF_PX = 3.0
"""RMS distance of the images of a mark from where its corners are imaged, px of an image 1000 px wide: more is another
mark, or one that was moved."""

_SQUARE = 0.1
"""Share of the mean by which the sides of a marker may differ."""

_ANY = Pattern(9, 6)
"""It finds any chessboard; among equals, one of about this size is preferred."""


@dataclass(frozen=True)
class Mark:
    """A marker or a board on the floor."""

    name: str
    corners: Array
    """(N, 3) in the rig's world, metres; NaN where fewer than two views show one."""

    side_m: float
    """Side of the marker, or of the board's squares, as the rig measures it."""


def floor_marks(rig: Rig, pictures: Sequence[Image | None]) -> list[Mark]:
    """Markers of OpenCV's dictionaries (ArUco, AprilTag, of ChArUco boards), or else a chessboard.

    Args:
        rig: the cameras.
        pictures: one a view, as large as calibrated; None where a view has none.

    Raises:
        CalibrationError: two views show nothing of the kind, or none that fits the rig; or a picture has another size.
    """
    for camera, picture in zip(rig.cameras, pictures, strict=True):
        if picture is not None and (size := picture.shape[1::-1]) != camera.size:
            raise CalibrationError(
                f'view "{camera.name}": the picture of the floor has {size[0]}x{size[1]} px, the rig was calibrated at '
                f"{camera.size[0]}x{camera.size[1]} px"
            )
    shown = [[] if picture is None else list(_shown(plain_grey(picture))) for picture in pictures]
    marks = list(_markers(rig, shown)) or list(_chessboard(rig, pictures))
    if not marks:
        n_views = sum(map(bool, shown))
        seen = f"markers are seen in {n_views} of {len(rig)} views" if n_views else "no board and no marker is seen"
        raise CalibrationError(
            f"floor: {seen}, and none in two views at a place that fits the rig; expected a chessboard, a ChArUco "
            "board or markers (ArUco, AprilTag) that lie still on the floor, large in the pictures"
        )
    return marks


def _shown(grey: Image) -> Iterator[tuple[str, int, Array]]:
    """Dictionary, number and corners (4, 2) px of the markers in a picture, black on white or the other way round."""
    for shown in (grey, 255 - grey):
        for names in families().values():
            for corners, number in zip(*markers_in(shown, names[-1]), strict=True):
                yield names[-1], int(number), np.asarray(corners, dtype=np.float64).reshape(4, 2)


def _markers(rig: Rig, shown: list[list[tuple[str, int, Array]]]) -> Iterator[Mark]:
    keys = dict.fromkeys((family, number) for markers in shown for family, number, _ in markers)
    for family, number in keys:
        pixels = np.full((len(rig), 4, 2), np.nan)
        for v, markers in enumerate(shown):
            mine = [corners for name, k, corners in markers if (name, k) == (family, number)]
            if len(mine) == 1:  # of two alike nobody knows which is which
                pixels[v] = mine[0]
        corners = _fitting(rig, pixels)
        if corners is None:
            continue
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
        if np.ptp(sides) < 2 * _SQUARE * sides.mean():
            yield Mark(f"marker {number} of {family}", corners, float(sides.mean()))


def _chessboard(rig: Rig, pictures: Sequence[Image | None]) -> Iterator[Mark]:
    there = (plain_grey(picture) for picture in pictures if picture is not None)
    found = next((board for picture in there for board in chessboards(picture, _ANY)), None)
    if found is None:
        return
    pattern = found.pattern
    shown = [None if picture is None else find_board(picture, pattern)[1] for picture in pictures]
    views = [v for v, corners in enumerate(shown) if corners is not None and len(corners)]
    pixels = np.full((len(rig), pattern.columns * pattern.rows, 2), np.nan)
    for v in views:
        own = np.asarray(shown[v])
        turned = [own[order] for order in orders_alike(*pattern.size)]
        pixels[v] = turned[0] if v == views[0] else min(turned, key=lambda one: _off_px(rig, views[0], v, pixels, one))
    corners = _fitting(rig, pixels)
    if corners is None:
        return
    grid = corners.reshape(pattern.rows, pattern.columns, 3)
    side_m = float(np.nanmedian(np.linalg.norm(np.diff(grid, axis=1), axis=2)))
    yield Mark(f"chessboard of {pattern.columns} x {pattern.rows} inner corners", corners, side_m)


def _off_px(rig: Rig, first: int, other: int, pixels: Array, own: Array) -> float:
    """RMS distance of images in two views from those of the points that they tell, px; of one order of a board."""
    pair = Rig((rig.cameras[first], rig.cameras[other]))
    both = np.stack([pixels[first], own])
    return _rms(pair.project(pair.triangulate(both)[0]) - both)


def _fitting(rig: Rig, pixels: Array) -> Array | None:
    """(N, 3) points of images (V, N, 2), if two views show them and they fit the rig; else None."""
    if np.isfinite(pixels).all(axis=(1, 2)).sum() < 2:
        return None
    points, _ = rig.triangulate(pixels)
    widest = max(camera.size[0] for camera in rig.cameras)
    off = _rms(rig.project(points) - pixels)
    return points if off < _MOST_OFF_PX * max(1.0, widest / 1000) else None


def _rms(off: Array) -> float:
    """Entries of known distances (..., 2)."""
    squares = (off**2).sum(axis=-1)
    return float(np.sqrt(np.nanmean(squares))) if np.isfinite(squares).any() else np.inf
