"""Projection of single points, shared by the compiled kernels."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array, Array32


def project_point(camera: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Image of a world point; the twin is `Camera.project`.

    Args:
        camera: (29,) row of `Rig.packed`.
        x, y, z: world position, metres.

    Returns:
        Pixel u, v and the depth in metres, 0 beyond the reach of the lens (pixel 0, 0 when it is not positive).
    """
    return native.project_point(camera, x, y, z)


def project_grid(placement: Array, grid: Array32, camera: Array, pixels: Array) -> float:
    """Images of the points of a part; several at a time, for nothing branches.

    Args:
        placement: (4, 4) world_from_part, metres.
        grid: (N, 3 or more) points of the part, metres.
        camera: (29,) row of `Rig.packed`.
        pixels: (3, N) output: pixels, of use only where all points lie before the camera, and depths, metres; 0 beyond
            the reach of the lens.

    Returns:
        Least depth, metres.
    """
    return native.project_grid(placement, grid, camera, pixels)
