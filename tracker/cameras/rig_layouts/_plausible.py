"""Numbers that a camera can have and yet hardly has: of another unit, another image size, another order."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from tracker.cameras.camera import Camera
from tracker.cameras.lens import Lens
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array
from tracker.foundation.errors import CalibrationError, nearest
from tracker.foundation.source_files import METRES_PER_UNIT, unit_sign

_GUESSED = {"m": "metres", "cm": "centimetres", "mm": "millimetres"}
"""Units that a file without a word for them may be in."""

FARTHEST_M, _FAR_M = 200.0, 30.0
"""A room is metres across: hundreds of metres between cameras are refused, tens of metres give a warning."""

_NEAR_M = 0.02
"""Cameras all within that are not believed either, if another unit makes a room of them: lenses are as wide."""

_ROOM_M = 0.5, 60.0
"""Distance of the two cameras of a room that are farthest from one another."""

_USUAL_M = 4.0
"""If several units make a room, the one nearest to this comes first."""


def unit_of(word: object) -> str:
    """The sign of the unit in a word such as `mm` or `millimeters`.

    Raises:
        CalibrationError: it is none.
    """
    unit = unit_sign(word) if isinstance(word, str) else None
    if unit is None:
        raise CalibrationError(f'units = "{word}": {nearest(str(word), METRES_PER_UNIT)}')
    return unit


def in_metres(cameras: Sequence[Camera], unit: str, scale: float = 1.0) -> tuple[Camera, ...]:
    """The cameras with their places in metres.

    Args:
        cameras: their places in a unit.
        unit: sign of it, see `tracker.foundation.source_files`.
        scale: by which lengths are multiplied besides.

    Raises:
        CalibrationError: the scale is no factor of lengths.
    """
    if not (math.isfinite(scale) and scale > 0):
        raise CalibrationError(f"scale = {scale:g}: expected a factor above 0, by which lengths are multiplied")
    factor = scale * METRES_PER_UNIT[unit]
    moved = []
    for camera in cameras:
        motion = np.array(camera.camera_from_world)
        motion[:3, 3] *= factor
        moved.append(replace(camera, camera_from_world=motion))
    return tuple(moved)


def unit_remarks(cameras: Sequence[Camera], unit: str, path: Path, told: bool) -> tuple[str, ...]:
    """Warning about cameras tens of metres from one another.

    Args:
        cameras: with places in metres.
        unit: that the file was read in.
        path: of the file.
        told: whether the user gave the unit or the scale: then cameras may stand within millimetres.

    Raises:
        CalibrationError: they stand hundreds of metres from one another, or all within millimetres although another
            unit makes a room of them.
    """
    centres = np.stack([camera.centre for camera in cameras])
    farthest = max(float(np.linalg.norm(centres - centre, axis=1).max()) for centre in centres)
    if (told or farthest >= _NEAR_M) and farthest <= _FAR_M:
        return ()
    metres = METRES_PER_UNIT
    others = {other: farthest * metres[other] / metres[unit] for other in _GUESSED if other != unit}
    rooms = {other: wide for other, wide in others.items() if _ROOM_M[0] <= wide <= _ROOM_M[1]}
    units = sorted(rooms, key=lambda other: abs(math.log(rooms[other] / _USUAL_M)))
    apart = f"{farthest:.0f} m" if farthest > 1 else f"{1000 * farthest:.1f} mm"
    line = f"two cameras are {apart} apart, expected a room: "
    if units:
        line += (
            f"in {' or in '.join(f'{_GUESSED[other]} they are {rooms[other]:.2g} m apart' for other in units)}: if the "
            f"file is in {_GUESSED[units[0]]}, `bodytrack rig convert {path} rig.toml --units {units[0]}` reads it so"
        )
    else:
        line += f"if its lengths have another unit, use `bodytrack rig convert {path} rig.toml --scale METRES`"
    if farthest > FARTHEST_M or (units and farthest < _NEAR_M):
        raise CalibrationError(line)
    return (line,) if units else ()


def up_remarks(cameras: Sequence[Camera]) -> tuple[str, ...]:
    """Warning about a file's world with another axis up than z."""
    up = Rig(tuple(cameras)).likely_up if cameras else "z"
    if up == "z":
        return ()
    return (
        f"z is not up in this file, {up} seems to be: `bodytrack rig convert THIS rig.toml --up {up}` turns it, and "
        "--floor METRES tells where the floor lies along that axis",
    )


_SHORTEST = 1 / 20
"""Least focal length, in widths of the image: 168 degrees; shorter ones are in mm, or in widths."""

_OFF_CENTRE, _CENTRED = 0.25, 0.1
"""Distance of the principal point from the middle, in widths and heights: of a lens that is cropped, and of most."""


def check_interior(camera: Camera) -> None:
    """Refuses what can be read, and is of another image.

    Raises:
        CalibrationError: width and height are exchanged, or the focal length is in another unit than pixels.
    """
    (width, height), (fx, fy) = camera.size, camera.matrix[[0, 1], [0, 1]]
    if max(fx, fy) < _SHORTEST * max(width, height):
        raise CalibrationError(
            f'camera "{camera.name}": focal length {fx:.4g}, {fy:.4g} px of a {width}x{height} image, expected '
            "hundreds: in px it is the millimetres of the lens over the millimetres of one pixel"
        )
    if _off_centre(camera, (width, height)) > _OFF_CENTRE and _off_centre(camera, (height, width)) < _CENTRED:
        x, y = camera.matrix[:2, 2]
        raise CalibrationError(
            f'camera "{camera.name}": size {width}x{height} px, and the principal point ({x:.0f}, {y:.0f}) px lies in '
            f"the middle of {height}x{width}: width and height are exchanged"
        )


def interior_remarks(cameras: Sequence[Camera]) -> tuple[str, ...]:
    """Warnings about principal points far from the middle, and about names that differ only by capital letters."""
    remarks = []
    for camera in cameras:
        if _off_centre(camera, camera.size) > _OFF_CENTRE:
            (width, height), (x, y) = camera.size, camera.matrix[:2, 2]
            remarks.append(
                f'camera "{camera.name}": its principal point ({x:.0f}, {y:.0f}) px lies far from the middle of the '
                f"{width}x{height} image: right for an image that was cropped; else it is counted from the middle, or "
                "of another image size"
            )
    alike = Counter(camera.name.casefold() for camera in cameras)
    twice = [camera.name for camera in cameras if alike[camera.name.casefold()] > 1]
    if twice:
        named = ", ".join(f'"{name}"' for name in twice)
        remarks.append(f"names that differ by capital letters alone: {named}: on some systems their files are one")
    return tuple(remarks)


def _off_centre(camera: Camera, size: tuple[int, int]) -> float:
    middle = (np.array(size) - 1) / 2
    return float((np.abs(camera.matrix[:2, 2] - middle) / size).max())


# Lenses of other models, and with fewer terms: the numbers of OpenCV's model that image as they do.

_COLUMNS, _ROWS = 33, 25
"""Pixels of the image at which two lenses are compared: its corners, its edges and within."""

_MOST_PX = 20.0
"""Largest loss in the image by fewer terms: beyond, they make another lens."""

_TERMS = {4: "k1 k2 p1 p2", 5: "k1 k2 p1 p2 k3"}
"""Distortion coefficients of layouts that hold fewer than a `Camera`, in OpenCV's order."""


@dataclass(frozen=True)
class Refit:
    """A lens that was fitted to another one."""

    matrix: Array
    """(3, 3) intrinsic matrix, px."""

    distortion: Array
    """(8,) of a `Camera`."""

    rms_px: float
    """Root mean square of the distances between what both image, over the whole image."""

    most_px: float
    """The largest of these distances."""


def image_grid(size: tuple[int, int]) -> Array:
    """(N, 2) px, evenly over an image of a width and height, its corners among them."""
    columns, rows = np.meshgrid(np.linspace(0, size[0] - 1, _COLUMNS), np.linspace(0, size[1] - 1, _ROWS))
    return np.column_stack([columns.ravel(), rows.ravel()])


def refitted(matrix: Array, planes: Array, pixels: Array, terms: int, free: bool) -> Refit:
    """The lens that comes nearest to images of directions.

    Args:
        matrix: (3, 3) intrinsic matrix to begin with, px.
        planes: (N, 2) directions, in the plane z = 1.
        pixels: (N, 2) where they are imaged, px.
        terms: how many distortion coefficients there are, 4 (k1 k2 p1 p2) or 5 (with k3).
        free: whether focal lengths and principal point are fitted as well.
    """
    begin = np.concatenate([np.zeros(terms), matrix[[0, 1, 0, 1], [0, 1, 2, 2]] if free else []])

    def lens_of(values: Array) -> tuple[Array, Array]:
        inner = np.array(matrix)
        if free:
            inner[[0, 1, 0, 1], [0, 1, 2, 2]] = values[terms:]
        return inner, np.pad(values[:terms], (0, 8 - terms))

    def errors(values: Array) -> Array:
        inner, lens = lens_of(values)
        imaged: Array = Lens(lens).distorted(planes) @ inner[:2, :2].T + inner[:2, 2] - pixels
        return imaged.ravel()

    found = least_squares(errors, begin, x_scale="jac", method="lm", max_nfev=200)
    distances = np.linalg.norm(found.fun.reshape(-1, 2), axis=1)
    inner, lens = lens_of(found.x)
    return Refit(inner, lens, float(np.sqrt((distances**2).mean())), float(distances.max()))


def with_terms(camera: Camera, terms: int) -> tuple[Camera, str]:
    """The camera with so many distortion coefficients, and what that costs, in words; empty if nothing.

    Focal lengths and the principal point are fitted as well, for they take over what the terms that are left cannot.

    Args:
        camera: as it is.
        terms: 4, 5 or 8.

    Raises:
        CalibrationError: a lens with so few terms images nothing like it.
    """
    if not camera.distortion[terms:].any():
        return camera, ""
    pixels = image_grid(camera.size)
    planes = camera.undistort(pixels)
    shown = np.isfinite(planes).all(axis=1)
    found = refitted(camera.matrix, planes[shown], pixels[shown], terms, free=True)
    told = (
        f'camera "{camera.name}": this layout holds the distortion {_TERMS[terms]} alone; the nearest such lens is '
        f"{found.rms_px:.2g} px off over the image (RMS), {found.most_px:.2g} px at most"
    )
    fitted = replace(camera, matrix=found.matrix, distortion=found.distortion)
    if found.most_px > _MOST_PX or fitted.turns_back_px is not None:
        raise CalibrationError(f"{told}: that is another lens: choose another layout")
    return fitted, told
