"""How far the mean of a followed patch lies from its centre, from the affine terms of its neighbours."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Integers, Mask
from tracker.kernels.compilation import compiled

LEAST_NEIGHBOURS = 6
"""Twice the unknowns of a plane through their differences."""

LARGEST_PX = 0.5
"""A larger correction is no curvature but a wrong neighbour."""

NO_SPREAD_PX2 = 1.0
"""Regularizes neighbours that lie at one place."""

NO_SHIFT_PX2 = 1e-12
"""Keeps 0 / 0 away."""


@compiled
def bending_shifts(offsets: Array, rows: Integers, affine: Array, known: Mask, half: int) -> Array:
    """Shift of each patch's mean against its centre (N, 2) px; 0 where neighbours cannot tell.

    By Taylor's theorem it is ``(s_xx + s_yy) m / 2`` with m the mean square of a pixel's offset along an axis; the
    second derivatives are the slopes of the affine terms over the neighbours. Each shift is multiplied by the Wiener
    weight ``|mean s|^2 / mean |s|^2`` over the point and its neighbours.

    Args:
        offsets: (N, K, 2) of the neighbours from the points at birth, px.
        rows: (N, K) rows of the neighbours, -1 for none.
        affine: (N, 2, 2) from birth to now.
        known: (N,) points whose affine transformations are those of the present frame.
        half: the patch has 2 half + 1 pixels a side.
    """
    raw, usable = np.zeros((len(rows), 2)), np.zeros(len(rows), dtype=np.bool_)
    for n in range(len(rows)):
        if known[n]:
            usable[n] = _raw_shift(offsets[n], rows[n], affine, known, n, half, raw[n])
    shifts = np.zeros((len(rows), 2))
    for n in range(len(rows)):
        x, y = raw[n, 0], raw[n, 1]
        square, count = x * x + y * y, 1
        for k in rows[n]:
            if k >= 0 and usable[k]:
                x, y, count = x + raw[k, 0], y + raw[k, 1], count + 1
                square += raw[k, 0] ** 2 + raw[k, 1] ** 2
        weight = (x * x + y * y) / (count * max(square, NO_SHIFT_PX2))
        shifts[n, 0], shifts[n, 1] = weight * raw[n, 0], weight * raw[n, 1]
    return shifts


@compiled
def _raw_shift(offsets: Array, rows: Integers, affine: Array, known: Mask, own: int, half: int, shift: Array) -> bool:
    """Fills the shift of one point; returns whether its neighbours suffice."""
    count, mean_x, mean_y = 1.0, 0.0, 0.0
    xx, yy, xy = NO_SPREAD_PX2, NO_SPREAD_PX2, 0.0
    # sums of dA and of o dA; A's terms row by row
    mean, along, down = np.zeros(4), np.zeros(4), np.zeros(4)
    for k in range(len(rows)):
        x, y, row = offsets[k, 0], offsets[k, 1], rows[k]
        if row < 0 or not known[row] or not np.isfinite(x):
            continue
        count, mean_x, mean_y = count + 1.0, mean_x + x, mean_y + y
        xx, yy, xy = xx + x * x, yy + y * y, xy + x * y
        for t in range(4):
            difference = affine[row, t // 2, t % 2] - affine[own, t // 2, t % 2]
            mean[t] += difference
            along[t] += x * difference
            down[t] += y * difference
    if count <= LEAST_NEIGHBOURS:
        return False
    mean_x, mean_y = mean_x / count, mean_y / count
    xx, yy, xy = xx - count * mean_x * mean_x, yy - count * mean_y * mean_y, xy - count * mean_x * mean_y
    determinant = xx * yy - xy * xy
    for axis in range(2):
        first, second = 2 * axis, 2 * axis + 1
        rise_x = (yy * (along[first] - mean_x * mean[first]) - xy * (down[first] - mean_y * mean[first])) / determinant
        rise_y = (
            xx * (down[second] - mean_y * mean[second]) - xy * (along[second] - mean_x * mean[second])
        ) / determinant
        shift[axis] = half * (half + 1) / 6.0 * (rise_x + rise_y)
    if not max(abs(shift[0]), abs(shift[1])) <= LARGEST_PX:
        shift[:] = 0.0
        return False
    return True
