"""Cubic B-spline interpolation of image patches under an affine transformation."""

from __future__ import annotations

import numpy as np

import tracker._native as native
from tracker.foundation.arrays import Array, Array32

SplineImage = tuple[Array32, int, int]
"""Spline coefficients of an image, row by row (h * w,), its width and its height, px."""

MARGIN = 2
"""Patches reach no nearer to the border than this, px: the splines need the pixels around."""


def reaches_out(warp: Array, half: int, width: int, height: int) -> bool:
    """Whether a patch touches the border.

    Args:
        warp: (6,) position of the centre, then the affine matrix row by row.
        half: the patch has 2 half + 1 pixels a side.
        width, height: of the image, px.
    """
    return native.reaches_out(warp, half, width, height)


def sample_patch(image: SplineImage, warp: Array, half: int, values: Array32) -> None:
    """Grey values under an affinely transformed patch, which must lie inside.

    Args:
        image: spline coefficients, width and height.
        warp: (6,) position of the centre, then the affine matrix row by row.
        half: the patch has 2 half + 1 pixels a side.
        values: (>= n) written, row by row.
    """
    native.sample_patch(image, warp, half, values)


def sample_gradient(
    image: SplineImage, warp: Array, half: int, values: Array32, dx_of: Array32, dy_of: Array32
) -> None:
    """Grey values and image gradients under an affinely transformed patch, as `sample_patch`.

    Args:
        image, warp, half, values: see `sample_patch`.
        dx_of, dy_of: (>= n) written: derivatives along the image's x and y, grey levels per px.
    """
    native.sample_gradient(image, warp, half, values, dx_of, dy_of)


def sample_whole_pixels(
    image: SplineImage, column: int, row: int, half: int, values: Array32, dx_of: Array32, dy_of: Array32
) -> None:
    """Grey values and gradients as `sample_gradient`, of an upright patch whose centre is a whole pixel.

    Three coefficients in a row instead of four, the same ones for all pixels: ten times as fast.
    """
    upright = np.array([column, row, 1.0, 0.0, 0.0, 1.0])
    native.sample_whole_pixels(image, upright, half, values, dx_of, dy_of)
