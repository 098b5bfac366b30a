"""How alike the texture of two pictures is: correlation in a window that goes along the rows."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Image, Integers
from tracker.kernels.compilation import compiled

_WINDOW = 4
"""Half the window of the correlation, px."""


@compiled
def sum_columns(now: Image, before: Image, x: int, y: int, known: Integers, sums: Integers) -> None:
    """Sums and products of the grey values in the columns of the window around a pixel.

    Args:
        now, before: smoothed image and plate.
        x, y: the pixel.
        known: (W,) row for which the sums of each column are known; from the row before, they take two
            pixels each.
        sums: (W, 5) output, a row for each column.
    """
    top, bottom = y - _WINDOW, y + _WINDOW
    for column in range(x - _WINDOW, x + _WINDOW + 1):
        if known[column] == y:
            continue
        if known[column] == y - 1:
            _add_pixel(now, before, column, top - 1, -1, sums)
            _add_pixel(now, before, column, bottom, 1, sums)
        else:
            for k in range(5):
                sums[column, k] = 0
            for row in range(top, bottom + 1):
                _add_pixel(now, before, column, row, 1, sums)
        known[column] = y


@compiled
def _add_pixel(now: Image, before: Image, x: int, y: int, sign: int, sums: Integers) -> None:
    """Adds a pixel to the sums of its column, or takes it away."""
    a = np.int64(now[y, x, 0]) + np.int64(now[y, x, 1]) + np.int64(now[y, x, 2])
    b = np.int64(before[y, x, 0]) + np.int64(before[y, x, 1]) + np.int64(before[y, x, 2])
    sums[x, 0] += sign * a
    sums[x, 1] += sign * b
    sums[x, 2] += sign * a * a
    sums[x, 3] += sign * b * b
    sums[x, 4] += sign * a * b


@compiled
def correlation(sums: Integers, x: int) -> float:
    """Normalized cross-correlation in the window around column x, near 0 where there is no texture."""
    a = b = aa = bb = ab = 0
    for column in range(x - _WINDOW, x + _WINDOW + 1):
        a += sums[column, 0]
        b += sums[column, 1]
        aa += sums[column, 2]
        bb += sums[column, 3]
        ab += sums[column, 4]
    n = float((2 * _WINDOW + 1) ** 2)
    # The least variance is that of a grey level; three channels are summed.
    varying = max(aa / n - (a / n) ** 2, 9.0) * max(bb / n - (b / n) ** 2, 9.0)
    return float((ab / n - (a / n) * (b / n)) / np.sqrt(varying))
