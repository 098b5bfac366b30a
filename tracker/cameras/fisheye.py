"""Fisheye lenses, as a quotient of polynomials that images as they do.

The fisheye model of OpenCV (Kannala & Brandt 2006) is a polynomial of the angle to the optical axis. A camera here has
the rational radial distortion of OpenCV's pinhole model, which six numbers lead along the same curve: to 0.05 px of a
lens of 900 px over 75 degrees, to a thousandth over 60. At 75 such a lens ends (`Lens.reach`): the quotient would be
0.6 px off at 77 degrees, 7 at 80, 180 at 85.
"""

from __future__ import annotations

import numpy as np

from tracker.cameras.camera import Camera
from tracker.cameras.lens import FARTHEST_DEG, Lens
from tracker.foundation.arrays import Array
from tracker.foundation.errors import CalibrationError

_LARGEST = 1e6
"""Of a number of the polynomial: a lens has some hundredths."""

_MOST_OFF_PX = 0.2
"""Tolerance between both models inside the image: what good calibrations leave."""

_BEYOND = 1e-3
"""Weight of directions outside of the image, where the polynomial is an extrapolation."""

_ROUNDS = 20
"""Of weights: the quotient is fitted by its numerator, which its denominator stretches."""


def rational_of(name: str, size: tuple[int, int], matrix: Array, fisheye: Array) -> Array:
    """The distortion (8,) of a `Camera` that images as a fisheye lens does.

    Args:
        name: of the camera, for messages.
        size: image width and height, px.
        matrix: (3, 3) intrinsic matrix of a `Camera`.
        fisheye: (4,) k1 k2 k3 k4 of OpenCV's fisheye model.

    Raises:
        CalibrationError: the lens images two directions in one place inside the image, no quotient is near it, or
            a number is none of a lens.
    """
    if np.abs(fisheye).max() > _LARGEST:
        raise CalibrationError(
            f'camera "{name}": fisheye distortion {fisheye.tolist()} found, expected numbers below {_LARGEST:g}'
        )
    angles = np.radians(np.linspace(0.1, FARTHEST_DEG, 1500))
    bent, end = _bent(name, size, matrix, fisheye, angles)
    inside, planes = angles <= end, np.tan(angles)
    lens = _fitted(planes, bent, np.where(inside, 1.0, _BEYOND))
    across = np.stack([planes[inside], np.zeros(inside.sum())], axis=-1)
    found = Lens(lens).distort(across)[0][:, 0]
    off_px = float(matrix[0, 0]) * np.abs(found - bent[inside]).max()
    if not (off_px <= _MOST_OFF_PX and (np.diff(found) > 0).all()):
        raise CalibrationError(
            f'camera "{name}": a fisheye lens that no quotient of polynomials follows ({off_px:.2g} px off, at most '
            f"{_MOST_OFF_PX:g} expected): is it OpenCV's fisheye model? Else undistort the images first"
        )
    return lens


def told_end(camera: Camera) -> str | None:
    """What to know of a wide lens that ends inside the image; None of others."""
    lens = Lens(camera.distortion)
    end_px = camera.inside_px(lens.reach) if lens.reach < lens.turns_back else None
    if end_px is None:
        return None
    return (
        f'camera "{camera.name}": its lens is known to {FARTHEST_DEG:.0f} degrees from the axis, {end_px:.0f} px from '
        "the principal point, inside the image: what is farther out does not count"
    )


def _bent(name: str, size: tuple[int, int], matrix: Array, fisheye: Array, angles: Array) -> tuple[Array, float]:
    """Distances from the axis at which directions are imaged, in focal lengths, and the angle that the corners show.

    Where the polynomial turns back outside of the image it is continued straight.
    """
    squares = angles**2
    k1, k2, k3, k4 = fisheye
    bent = angles * (1 + squares * (k1 + squares * (k2 + squares * (k3 + squares * k4))))
    corners = np.array([(x, y) for x in (0, size[0] - 1) for y in (0, size[1] - 1)], dtype=np.float64)
    farthest = np.linalg.norm((corners - matrix[:2, 2]) @ np.linalg.inv(matrix[:2, :2]).T, axis=1).max()
    # the image ends where its farthest corner is reached
    end = int(np.argmax(bent >= farthest)) if (bent >= farthest).any() else len(bent) - 1
    slopes = np.gradient(bent, angles)
    if (slopes[: end + 1] <= 0).any():
        raise CalibrationError(
            f'camera "{name}": its fisheye lens images two directions in one place '
            f"{matrix[0, 0] * bent[np.argmax(slopes <= 0)]:.0f} px from the principal point, inside the image: "
            "calibrate it anew with views whose corners show something, or with fewer terms"
        )
    if (slopes <= 0).any():
        bent = np.where(angles > angles[end], bent[end] + slopes[end] * (angles - angles[end]), bent)
    return bent, float(angles[end])


def _fitted(planes: Array, bent: Array, weights: Array) -> Array:
    """Distortion (8,) of which plane coordinates come nearest to where they are imaged."""
    squares, ratios = planes**2, bent / planes
    powers = squares[:, None] ** np.arange(1, 4)
    matrix = np.hstack([powers, -ratios[:, None] * powers])
    under = np.ones_like(planes)
    found = np.zeros(6)
    for _ in range(_ROUNDS):
        rows = weights * planes / under
        scaled = matrix * rows[:, None]
        lengths = np.linalg.norm(scaled, axis=0)
        found = np.linalg.lstsq(scaled / lengths, (ratios - 1) * rows, rcond=1e-14)[0] / lengths
        under = np.maximum(1 + powers @ found[3:], 1e-3)
    return np.array([found[0], found[1], 0, 0, found[2], *found[3:]])
