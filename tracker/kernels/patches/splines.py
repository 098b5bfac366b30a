"""Cubic B-spline interpolation of image patches under an affine transformation."""

from __future__ import annotations

from typing import Any

import numpy as np

from tracker.arrays import Array, Array32
from tracker.kernels.compilation import compiled

SplineImage = tuple[Array32, int, int]
"""Spline coefficients of an image, row by row (h * w,), its width and its height, px."""

MARGIN = 2
"""Patches reach no nearer to the border than this, px: the splines need the pixels around."""

# Pixel positions are counted from a whole pixel so far up and left that no patch goes below 0: truncation is then
# the floor, and single precision is fine enough (1e-5 px).
_ORIGIN = 64


@compiled(fastmath=True)
def _weights(f: Any) -> tuple[Any, Any, Any, Any]:
    """The four cubic B-splines that reach a point a fraction f beyond a pixel."""
    rest, f2 = np.float32(1.0) - f, f * f
    third = f2 * f
    w0 = rest * rest * rest * np.float32(1 / 6)
    w1 = np.float32(2 / 3) - f2 + third * np.float32(0.5)
    w3 = third * np.float32(1 / 6)
    return w0, w1, np.float32(1.0) - w0 - w1 - w3, w3


@compiled(fastmath=True)
def _slopes(f: Any) -> tuple[Any, Any, Any, Any]:
    """Derivatives of the four B-splines by f."""
    half, rest = np.float32(0.5), np.float32(1.0) - f
    w0, w3 = -half * rest * rest, half * f * f
    w1 = np.float32(1.5) * f * f - np.float32(2.0) * f
    return w0, w1, -w0 - w1 - w3, w3


@compiled(fastmath=True)
def _row(image: Array32, at: Any, w0: Any, w1: Any, w2: Any, w3: Any) -> Any:
    """Four coefficients of a row, weighted."""
    return w0 * image[at] + w1 * image[at + 1] + w2 * image[at + 2] + w3 * image[at + 3]


@compiled
def reaches_out(warp: Array, half: int, width: int, height: int) -> bool:
    """Whether a patch touches the border.

    Args:
        warp: (6,) position of the centre, then the affine matrix row by row.
        half: the patch has 2 half + 1 pixels a side.
        width, height: of the image, px.
    """
    reach_x = half * (abs(warp[2]) + abs(warp[3])) + MARGIN
    reach_y = half * (abs(warp[4]) + abs(warp[5])) + MARGIN
    inside_x = warp[0] - reach_x >= 0.0 and warp[0] + reach_x <= width - 1
    inside_y = warp[1] - reach_y >= 0.0 and warp[1] + reach_y <= height - 1
    # Written so that NaN reaches out.
    return not (inside_x and inside_y and max(reach_x, reach_y) < _ORIGIN)


@compiled(fastmath=True)
def sample_patch(image: SplineImage, warp: Array, half: int, values: Array32) -> None:
    """Grey values under an affinely transformed patch, which must lie inside.

    Args:
        image: spline coefficients, width and height.
        warp: (6,) position of the centre, then the affine matrix row by row.
        half: the patch has 2 half + 1 pixels a side.
        values: (>= n) written, row by row.
    """
    flat, width, _ = image
    column, row = int(np.floor(warp[0])) - _ORIGIN, int(np.floor(warp[1])) - _ORIGIN
    x, y = np.float32(warp[0] - column), np.float32(warp[1] - row)
    a, b, c, d = np.float32(warp[2]), np.float32(warp[3]), np.float32(warp[4]), np.float32(warp[5])
    start, stride = (row - 1) * width + column - 1, np.int32(width)
    size = 2 * half + 1
    for j in range(size):
        dy = np.float32(j - half)
        for i in range(size):
            dx = np.float32(i - half)
            u, v = x + a * dx + b * dy, y + c * dx + d * dy
            iu, iv = np.int32(u), np.int32(v)
            p0, p1, p2, p3 = _weights(u - np.float32(iu))
            q0, q1, q2, q3 = _weights(v - np.float32(iv))
            at = np.uint64(start + iv * stride + iu)
            step = np.uint64(stride)
            value = q0 * _row(flat, at, p0, p1, p2, p3)
            value += q1 * _row(flat, at + step, p0, p1, p2, p3)
            value += q2 * _row(flat, at + step + step, p0, p1, p2, p3)
            value += q3 * _row(flat, at + step + step + step, p0, p1, p2, p3)
            values[j * size + i] = value


@compiled(fastmath=True)
def sample_gradient(
    image: SplineImage, warp: Array, half: int, values: Array32, dx_of: Array32, dy_of: Array32
) -> None:
    """Grey values and image gradients under an affinely transformed patch, as `sample_patch`.

    Args:
        image, warp, half, values: see `sample_patch`.
        dx_of, dy_of: (>= n) written: derivatives along the image's x and y, grey levels per px.
    """
    flat, width, _ = image
    column, row = int(np.floor(warp[0])) - _ORIGIN, int(np.floor(warp[1])) - _ORIGIN
    x, y = np.float32(warp[0] - column), np.float32(warp[1] - row)
    a, b, c, d = np.float32(warp[2]), np.float32(warp[3]), np.float32(warp[4]), np.float32(warp[5])
    start, stride = (row - 1) * width + column - 1, np.int32(width)
    size = 2 * half + 1
    for j in range(size):
        dy = np.float32(j - half)
        for i in range(size):
            dx = np.float32(i - half)
            u, v = x + a * dx + b * dy, y + c * dx + d * dy
            iu, iv = np.int32(u), np.int32(v)
            p0, p1, p2, p3 = _weights(u - np.float32(iu))
            q0, q1, q2, q3 = _weights(v - np.float32(iv))
            s0, s1, s2, s3 = _slopes(u - np.float32(iu))
            t0, t1, t2, t3 = _slopes(v - np.float32(iv))
            at = np.uint64(start + iv * stride + iu)
            step = np.uint64(stride)
            r0 = _row(flat, at, p0, p1, p2, p3)
            r1 = _row(flat, at + step, p0, p1, p2, p3)
            r2 = _row(flat, at + step + step, p0, p1, p2, p3)
            r3 = _row(flat, at + step + step + step, p0, p1, p2, p3)
            along = q0 * _row(flat, at, s0, s1, s2, s3)
            along += q1 * _row(flat, at + step, s0, s1, s2, s3)
            along += q2 * _row(flat, at + step + step, s0, s1, s2, s3)
            along += q3 * _row(flat, at + step + step + step, s0, s1, s2, s3)
            values[j * size + i] = q0 * r0 + q1 * r1 + q2 * r2 + q3 * r3
            dx_of[j * size + i] = along
            dy_of[j * size + i] = t0 * r0 + t1 * r1 + t2 * r2 + t3 * r3


@compiled(fastmath=True)
def sample_whole_pixels(
    image: SplineImage, column: int, row: int, half: int, values: Array32, dx_of: Array32, dy_of: Array32
) -> None:
    """Grey values and gradients as `sample_gradient`, of an upright patch whose centre is a whole pixel.

    Three coefficients in a row instead of four, the same ones for all pixels: ten times as fast.
    """
    flat, width, _ = image
    size = 2 * half + 1
    side, middle, slope = np.float32(1 / 6), np.float32(2 / 3), np.float32(0.5)
    for j in range(size):
        # Slices, because an index that might be negative keeps the compiler from vectorizing.
        at = (row - half + j) * width + column - half - 1
        above, same = flat[at - width : at - width + size + 2], flat[at : at + size + 2]
        below = flat[at + width : at + width + size + 2]
        first, last = j * size, (j + 1) * size
        out, along, down = values[first:last], dx_of[first:last], dy_of[first:last]
        for i in range(size):
            left = side * (above[i] + below[i]) + middle * same[i]
            centre = side * (above[i + 1] + below[i + 1]) + middle * same[i + 1]
            right = side * (above[i + 2] + below[i + 2]) + middle * same[i + 2]
            out[i] = side * (left + right) + middle * centre
            along[i] = slope * (right - left)
            falls = side * (below[i] - above[i] + below[i + 2] - above[i + 2])
            down[i] = slope * (falls + middle * (below[i + 1] - above[i + 1]))
