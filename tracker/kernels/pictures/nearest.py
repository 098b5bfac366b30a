"""Which of the parts before a camera is the nearest, pixel by pixel: a small depth buffer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Integers, Mask


def project_surfaces(placements: Array, surfaces: Array, wanted: Mask, camera: Array, seen: Array) -> None:
    """Images of the points of parts.

    Args:
        placements: (P, 4, 4) world_from_part, metres.
        surfaces: (P, N, 3) points in the parts' frames, metres.
        wanted: (P,) parts that are meant.
        camera: (29,) row of `Rig.packed`.
        seen: (P, 3, N) output: pixels and inverse depths, 1 / m; NaN for parts that are not meant, or not wholly before
            the camera.
    """
    native.project_surfaces(placements, surfaces, wanted, camera, seen)


def draw_nearest(
    seen: Array, triangles: Integers, corner: tuple[int, int], depths: Array32, parts: NDArray[np.int16]
) -> None:
    """Draws the sides of parts that face the camera; inverse depths are linear in the image but for the lens.

    Args:
        seen: (P, 3, N) from `project_surfaces`.
        triangles: (T, 3) point numbers, anticlockwise seen from outside.
        corner: x, y of the pictures' first pixel in the image.
        depths: (h, w) in and out: inverse depth, 1 / m, 0 where there is nothing.
        parts: (h, w) in and out: number of the part.
    """
    native.draw_nearest(seen, triangles, corner, depths, parts)
