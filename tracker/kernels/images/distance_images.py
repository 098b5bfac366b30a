"""Chamfer images: distance of every pixel to the nearest of some pixels, clamped."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import tracker._native as native
from tracker.foundation.arrays import Array32


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
    native.chamfer_distances(pixels, reach, distance)
