"""Numbers that a camera can have and yet hardly has: of another image size, another unit, another order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from tracker.cameras.camera import Camera
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
