"""Numbers that a camera can have and yet hardly has: of another image size, another unit, another order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from tracker.cameras.camera import Camera
from tracker.cameras.lens import Lens
from tracker.foundation.arrays import Array
from tracker.foundation.errors import CalibrationError

_SHORTEST = 1 / 20
"""Of a focal length, in widths of the image: 168 degrees; shorter ones are in mm, or in widths."""

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
    """What to know of principal points far from the middle, and of names that differ by capital letters alone."""
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
"""Of what fewer terms may cost in the image: beyond, they make another lens."""

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
        imaged: Array = Lens(lens).distort(planes)[0] @ inner[:2, :2].T + inner[:2, 2] - pixels
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
