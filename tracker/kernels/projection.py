"""Projection of single points, shared by the compiled kernels."""

from __future__ import annotations

from numba import njit

from tracker.arrays import Array


@njit(cache=True, nogil=True, error_model="numpy")
def project_point(camera: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Image of a world point; the twin is `Camera.project`.

    Args:
        camera: (25,) row of `Rig.packed`.
        x, y, z: world position, metres.

    Returns:
        Pixel u, v and the depth in metres (pixel 0, 0 when the depth is not positive).
    """
    cx = camera[0] * x + camera[1] * y + camera[2] * z + camera[3]
    cy = camera[4] * x + camera[5] * y + camera[6] * z + camera[7]
    depth = camera[8] * x + camera[9] * y + camera[10] * z + camera[11]
    if depth <= 1e-9:
        return 0.0, 0.0, depth
    a, b = cx / depth, cy / depth
    r2 = a * a + b * b
    radial = 1.0 + r2 * (camera[19] + r2 * (camera[20] + r2 * camera[23]))
    u = a * radial + 2.0 * camera[21] * a * b + camera[22] * (r2 + 2.0 * a * a)
    v = b * radial + camera[21] * (r2 + 2.0 * b * b) + 2.0 * camera[22] * a * b
    return camera[15] * u + camera[24] * v + camera[17], camera[16] * v + camera[18], depth
