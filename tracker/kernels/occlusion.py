"""Ray tests against tapered superquadrics.

What a test needs of a part stands in one row of one array, `solids` (P, 29): numba passes an array by its nine
words, and slices cost a reference count, so that several arrays or slices would be most of the time of a test.

Columns: 0-11 motion (3x4) from the world into the part's frame in units of its half extents; 12-14 camera centre
in that frame; 15 largest squared distance of the surface from the origin there; 16-17 taper; 18-20 exponents 2/e2,
e2/e1 and 2/e1; 21-28 the part in the image, see `tracker.kernels.contour_tracing`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from tracker.arrays import Array


@njit(cache=True, nogil=True, error_model="numpy")
def inside_value(solids: Array, q: int, x: float, y: float, z: float) -> float:
    """Inside-outside function of part q at a point in units of its half extents.

    Args:
        solids: (P, 29) parts with exponents e1, e2 up to 1.
        q: the part.
        x, y, z: position in the part's frame divided by a1, a2, a3.

    Returns:
        Below 1 inside, 1 on the surface; 9 outside the bounding box and 0.5 inside the inscribed ellipsoid,
        both without evaluating powers.
    """
    if z > 1.0 or z < -1.0:
        return 9.0
    u = abs(x / (1.0 + solids[q, 16] * z))
    v = abs(y / (1.0 + solids[q, 17] * z))
    if u > 1.0 or v > 1.0:
        return 9.0
    if u * u + v * v + z * z < 1.0:
        return 0.5
    if solids[q, 18] == 2.0:
        around = (u * u + v * v) ** (0.5 * solids[q, 20])
    else:
        around = (u ** solids[q, 18] + v ** solids[q, 18]) ** solids[q, 19]
    return around + abs(z) ** solids[q, 20]


@njit(cache=True, nogil=True, error_model="numpy")
def _clipped(origin: float, direction: float, side: float, low: float, high: float) -> tuple[float, float]:
    """What is left of a ray between low and high inside the slab from -side to side."""
    inverse = 1.0 / direction if direction != 0.0 else 1e300
    enter, leave = (-side - origin) * inverse, (side - origin) * inverse
    return max(low, min(enter, leave)), min(high, max(enter, leave))


@njit(cache=True, nogil=True, error_model="numpy")
def blocks_ray(solids: Array, q: int, x: float, y: float, z: float) -> bool:
    """Whether part q covers a point seen from a camera.

    The ray is clipped to the part's bounding ellipsoid and box. Where it comes nearest to the centre, in units of
    the half extents, the inside-outside function is close to its least value along the ray; there and half-way
    to both ends of what is left of the ray it is evaluated.

    Args:
        solids: (P, 29) parts.
        q: the part.
        x, y, z: the point in the part's frame divided by a1, a2, a3.
    """
    ox, oy, oz = solids[q, 12], solids[q, 13], solids[q, 14]
    dx, dy, dz = x - ox, y - oy, z - oz
    length2 = dx * dx + dy * dy + dz * dz
    along = -(ox * dx + oy * dy + oz * dz) / length2
    nx, ny, nz = ox + along * dx, oy + along * dy, oz + along * dz
    gap = solids[q, 15] - (nx * nx + ny * ny + nz * nz)
    if gap <= 0.0:
        return False
    half = np.sqrt(gap / length2)
    low, high = along - half, min(along + half, 1.0)
    low, high = _clipped(ox, dx, 1.0 + abs(solids[q, 16]), low, high)
    low, high = _clipped(oy, dy, 1.0 + abs(solids[q, 17]), low, high)
    low, high = _clipped(oz, dz, 1.0, low, high)
    if high <= low:
        return False
    middle = min(max(along, low), high)
    if inside_value(solids, q, ox + middle * dx, oy + middle * dy, oz + middle * dz) < 1.0:
        return True
    t = 0.5 * (low + middle)
    if inside_value(solids, q, ox + t * dx, oy + t * dy, oz + t * dz) < 1.0:
        return True
    t = 0.5 * (middle + high)
    return inside_value(solids, q, ox + t * dx, oy + t * dy, oz + t * dz) < 1.0
