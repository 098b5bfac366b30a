"""The world frame of a calibrated rig: from bars laid on the floor, a floor board, given points, or level cameras."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pydantic

from tracker.cameras.calibration._board_looks import sighting
from tracker.cameras.calibration._boards import Pattern, find_corners
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image, Integers
from tracker.foundation.configuration.components import FilePath, PathPattern, component
from tracker.foundation.errors import CalibrationError
from tracker.foundation.geometry import rigid_motion
from tracker.foundation.source_files import METRES_PER_UNIT, number_in, rows_of

_UNITS = {"mm": "mm", "cm": "cm", "in": "inches"}
"""Units in which people measure boards and bars, and how they call them."""

_SHORTEST = 0.15
"""Focal length as a share of an image's longer side below which no pinhole lens is: 147 degrees wide."""


def square_fault(length_m: float) -> str | None:
    """Why the side of a board's square, or of its marker, cannot be so many metres; None if it can."""
    return _fault(length_m, (0.004, 0.25), 0.5, "a square of a board")


def bar_fault(length_m: float) -> str | None:
    """Why a hand-carried bar cannot be so many metres long; None if it can."""
    return _fault(length_m, (0.1, 5.0), 10.0, "a bar")


def focal_fault(focal_px: float, view: str, size: tuple[int, int]) -> str | None:
    """Why no lens of a view has such a focal length, px; None if one may have."""
    least = _SHORTEST * max(size)
    if focal_px >= least:
        return None
    return (
        f'focal_px = {focal_px:g} for view "{view}", expected at least {least:.0f} for {size[0]}x{size[1]} px: of a '
        "focal length in mm, it is that length times the image's width in px over the sensor's width in mm"
    )


def _fault(length_m: float, usual_m: tuple[float, float], most_m: float, thing: str) -> str | None:
    """Message that a thing is longer than `most_m`, with its length in other units if that is usual."""
    if length_m <= most_m:
        return None
    offers = [
        f"{length_m * METRES_PER_UNIT[unit]:.6g} if {length_m:g} {name} are meant"
        for unit, name in _UNITS.items()
        if usual_m[0] <= length_m * METRES_PER_UNIT[unit] <= usual_m[1]
    ]
    expected = f"expected metres, {most_m:g} at most"
    return f"{thing} is not {length_m:g} m long, {': '.join(filter(None, [expected, ', '.join(offers)]))}"


_MISPLACED = 0.1
"""Share of a floor board's diagonal by which its corners may be beside their places: more is another board."""


@component
class WorldFrame:
    """Origin and axes of the world; by default in the middle of the observed points, level as the cameras.

    Give one of: both bar frames, `points`, or `board`.
    """

    x_bar_frame: int | None = pydantic.Field(default=None, ge=0)
    """Frame in which the bar lies on the floor along x, its first end at the origin."""

    y_bar_frame: int | None = pydantic.Field(default=None, ge=0)
    """Frame in which the bar lies on the floor and points, from its end nearer to the origin, towards y."""

    points: FilePath | None = None
    """CSV of points of known position: columns x, y, z in metres and VIEW_u, VIEW_v in px, empty where not seen."""

    board: PathPattern | None = None
    """Images of a chessboard on the floor, for instance `floor/{view}.png`; its inner corner is the origin, z up."""

    board_columns: int = pydantic.Field(default=9, ge=3)
    """Inner corners of the floor board along x."""

    board_rows: int = pydantic.Field(default=6, ge=3)
    """Inner corners of the floor board along y."""

    board_square_m: float = pydantic.Field(default=0.03, gt=0)
    """Side of the floor board's squares, metres."""

    @pydantic.field_validator("board_square_m")
    @classmethod
    def _is_in_metres(cls, length_m: float) -> float:
        if fault := square_fault(length_m):
            raise ValueError(fault)
        return length_m

    def placed(self, rig: Rig, bars: tuple[Array, Array] | None, middle: Array) -> tuple[Rig, Array, str]:
        """The rig in the world.

        Args:
            rig: calibrated in any frame.
            bars: frame numbers (B,) and ends (B, 2, 3) in the rig's frame, if bars were seen.
            middle: (3,) middle of what was seen, in the rig's frame.

        Returns:
            The moved rig, world_from_rig (4, 4), and where the frame comes from.

        Raises:
            CalibrationError: the objects of the frame are not seen or do not define it.
        """
        given = [self.x_bar_frame is not None or self.y_bar_frame is not None, bool(self.points), bool(self.board)]
        if sum(given) > 1:
            raise CalibrationError("[calibration] world: give bar frames, points or board, not several of them")
        if given[0]:
            motion, source = self._from_bars(bars), "bars laid on the floor"
        elif self.points is not None:
            motion, source = _from_points(rig, self.points), f"points of {self.points.name}"
        elif self.board is not None:
            motion, source = self._from_board(rig, self.board), "a board on the floor"
            if len(orders_alike(self.board_columns, self.board_rows)) > 1:
                source += "; it looks the same when it is turned: look at which corner the origin is"
        else:
            motion, source = _level(rig, middle), "level cameras; origin in the middle of what was seen"
        return moved_rig(rig, motion), motion, source

    def _from_bars(self, bars: tuple[Array, Array] | None) -> Array:
        if bars is None or self.x_bar_frame is None or self.y_bar_frame is None:
            raise CalibrationError("[calibration] world: x_bar_frame and y_bar_frame are both needed, and a bar")
        along_x, along_y = (_bar_of(bars, frame) for frame in (self.x_bar_frame, self.y_bar_frame))
        if min(np.linalg.norm(along_x[0] - end) for end in along_y) > min(
            np.linalg.norm(along_x[1] - end) for end in along_y
        ):
            along_x = along_x[::-1]
        if np.linalg.norm(along_y[0] - along_x[0]) > np.linalg.norm(along_y[1] - along_x[0]):
            along_y = along_y[::-1]
        return _frame_of(along_x[0], along_x[1] - along_x[0], along_y[1] - along_y[0])

    def _from_board(self, rig: Rig, pattern: str) -> Array:
        size = self.board_columns, self.board_rows
        images, without = [], []
        for name in rig.names:
            path = Path(pattern.replace("{view}", name))
            found = _read(path) if path.is_file() else None
            corners = None if found is None else find_corners(found, size)
            if found is not None and corners is None:
                without.append(found)
            images.append(np.full((size[0] * size[1], 2), np.nan) if corners is None else corners)
        columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
        plan = self.board_square_m * np.stack([columns, rows, 0.0 * rows], axis=-1).reshape(-1, 3)
        corners = np.stack(images)
        corners = _from_one_end(rig, corners, plan, orders_alike(*size))
        points, _ = rig.triangulate(corners)
        if np.isfinite(points).all(axis=1).sum() < 4:
            raise CalibrationError(
                f"world: fewer than two views show the floor board of {size[0]}x{size[1]} inner corners in {pattern}"
                f"{_shown_instead(without, size)}"
            )
        off_m, most_m = _misfit(points, plan), _MISPLACED * float(np.linalg.norm(plan[-1]))
        if off_m > most_m:
            raise CalibrationError(
                f"world: the floor board's corners fit its plan to {off_m:.3f} m only, expected {most_m:.3f} m at "
                f"most: is board_square_m = {self.board_square_m:g} right, and is the board in one place in {pattern}?"
            )
        return aligned_to_level(plan, points, rig)


def orders_alike(columns: int, rows: int) -> list[Integers]:
    """Orders of a chessboard's corners that look alike: of an even sum from both ends, of a square from all sides."""
    grid = np.arange(columns * rows).reshape(rows, columns)
    turns = range(4) if columns == rows else (0, 2) if (columns - rows) % 2 == 0 else (0,)
    return [np.rot90(grid, k).ravel() for k in turns]


def _from_one_end(rig: Rig, corners: Array, plan: Array, orders: list[Integers]) -> Array:
    """Corners (V, N, 2) of a board, in all views in the order of the first one: in another where they fit better so."""
    shown = [v for v in range(len(rig)) if np.isfinite(corners[v]).all()]
    ordered = corners.copy()
    for v in shown[1:]:
        pair = Rig((rig.cameras[shown[0]], rig.cameras[v]))
        options = [corners[v, order] for order in orders]
        ordered[v] = min(
            options, key=lambda own: _misfit(pair.triangulate(np.stack([corners[shown[0]], own]))[0], plan)
        )
    return ordered


def _shown_instead(pictures: list[Image], size: tuple[int, int]) -> str:
    """A chessboard of another size in the pictures, in the form of a configuration."""
    found = sighting(pictures, Pattern(*size))
    if found is None or found.pattern.marker is not None:
        return ""
    inverted = " white on black" if found.pattern.inverted else ""
    columns, rows = found.pattern.size
    return f"; one with board_columns = {columns}, board_rows = {rows} is seen{inverted}"


def _misfit(points: Array, plan: Array) -> float:
    """RMS distance of points (N, 3) from a plan (N, 3) moved to them, metres; infinite for fewer than four."""
    known = np.isfinite(points).all(axis=1)
    if known.sum() < 4:
        return np.inf
    motion = rigid_motion(points, plan)
    gaps = points[known] @ motion[:3, :3].T + motion[:3, 3] - plan[known]
    return float(np.sqrt((gaps**2).sum(axis=1).mean()))


def moved_rig(rig: Rig, world_from_rig: Array) -> Rig:
    """The rig with its frame moved by (4, 4)."""
    back = np.linalg.inv(world_from_rig)
    return Rig(tuple(replace(camera, camera_from_world=camera.camera_from_world @ back) for camera in rig.cameras))


def aligned_to_level(plan: Array, points: Array, rig: Rig) -> Array:
    """Like `rigid_motion` of a board, turned over if its z pointed away from the cameras."""
    motion = rigid_motion(points, plan)
    above = np.mean([(motion[:3, :3] @ camera.centre + motion[:3, 3])[2] for camera in rig.cameras])
    return motion if above > 0 else np.diag([1.0, -1.0, -1.0, 1.0]) @ motion


def _bar_of(bars: tuple[Array, Array], frame: int) -> Array:
    frames, ends = bars
    found = ends[frames == frame]
    if not len(found) or not np.isfinite(found[0]).all():
        raise CalibrationError(f"world: the bar is not seen by two views in frame {frame}")
    bar: Array = found[0]
    return bar


def _frame_of(origin: Array, along_x: Array, towards_y: Array) -> Array:
    x = along_x / np.linalg.norm(along_x)
    z = np.cross(x, towards_y)
    if np.linalg.norm(z) < 0.2 * np.linalg.norm(towards_y):
        raise CalibrationError("world: the two bars are nearly parallel; lay one along x and one along y")
    z /= np.linalg.norm(z)
    motion = np.eye(4)
    motion[:3, :3] = x, np.cross(z, x), z
    motion[:3, 3] = -motion[:3, :3] @ origin
    return motion


def _level(rig: Rig, middle: Array) -> Array:
    """Z up as the cameras' mean, x to the right of the first camera."""
    up = -np.mean([camera.camera_from_world[1, :3] for camera in rig.cameras], axis=0)
    right = rig.cameras[0].camera_from_world[0, :3]
    return _frame_of(middle, right - up * (right @ up) / (up @ up), np.cross(up, right))


def _from_points(rig: Rig, path: Path) -> Array:
    positions, pixels = read_points(path, rig.names)
    points, _ = rig.triangulate(pixels)
    good = np.isfinite(points).all(axis=1)
    if good.sum() < 3:
        raise CalibrationError(f"{path}: {int(good.sum())} points are seen by two views, expected at least 3")
    motion = rigid_motion(points, positions)
    error = np.linalg.norm(points[good] @ motion[:3, :3].T + motion[:3, 3] - positions[good], axis=1)
    span = np.linalg.svd(positions[good] - positions[good].mean(axis=0), compute_uv=False)
    if span[1] < 0.05 * span[0]:
        raise CalibrationError(f"{path}: the points lie on a line, which defines no frame; add one beside it")
    if error.max() > 0.1 * span[0]:
        raise CalibrationError(
            f"{path}: the points fit the calibrated rig to {error.max():.2f} m only: positions in metres, and in the "
            "same order as the pixels?"
        )
    return motion


def read_points(path: Path, views: tuple[str, ...]) -> tuple[Array, Array]:
    """Positions (N, 3) metres and images (V, N, 2) px, NaN where not seen, of a CSV file.

    Raises:
        CalibrationError: the file or a column is missing, or a value is no number.
    """
    rows = rows_of(path, CalibrationError)
    wanted = ["x", "y", "z", *(f"{view}_{axis}" for view in views for axis in "uv")]
    missing = [name for name in wanted if name not in rows[0]]
    if missing:
        raise CalibrationError(f"{path}: no column {', '.join(missing)}; expected {', '.join(wanted)}")
    table = np.array(
        [
            [number_in(row, name, path, CalibrationError) if row[name].strip() else np.nan for name in wanted]
            for row in rows
        ]
    )
    return table[:, :3], np.moveaxis(table[:, 3:].reshape(len(table), len(views), 2), 1, 0)


def _read(path: Path) -> Image | None:
    image: Image | None = cv2.imread(str(path), cv2.IMREAD_COLOR)
    return image
