"""Ray tests against tapered superquadrics.

Arrays are indexed here, never sliced: a slice costs a reference count, which is most of the time of such a test.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from tracker.arrays import Array


@njit(cache=True, nogil=True, error_model="numpy")
def inside_value(shapes: Array, q: int, x: float, y: float, z: float) -> float:
    """Inside-outside function of part q at a point in units of its half extents.

    Args:
        shapes: (P, 7) packed superquadrics with exponents up to 1.
        q: the part.
        x, y, z: position in the part's frame divided by a1, a2, a3.

    Returns:
        Below 1 inside, 1 on the surface; 9 outside the bounding box and 0.5 inside the inscribed ellipsoid,
        both without evaluating powers.
    """
    if z > 1.0 or z < -1.0:
        return 9.0
    u = abs(x / (1.0 + shapes[q, 5] * z))
    v = abs(y / (1.0 + shapes[q, 6] * z))
    if u > 1.0 or v > 1.0:
        return 9.0
    if u * u + v * v + z * z < 1.0:
        return 0.5
    e1, e2 = shapes[q, 3], shapes[q, 4]
    if e2 == 1.0:
        around = (u * u + v * v) ** (1.0 / e1)
    else:
        around = (u ** (2.0 / e2) + v ** (2.0 / e2)) ** (e2 / e1)
    return around + abs(z) ** (2.0 / e1)


@njit(cache=True, nogil=True, error_model="numpy")
def blocks_ray(shapes: Array, reaches: Array, eyes: Array, q: int, x: float, y: float, z: float) -> bool:
    """Whether part q covers a point seen from a camera.

    The inside-outside function of a convex shape is quasi-convex along a ray, so its minimum is found by
    ternary search between the crossings of the bounding ellipsoid and box.

    Args:
        shapes: (P, 7) packed superquadrics with exponents up to 1.
        reaches: (P,) largest squared distance of the surface from the centre in units of the half extents.
        eyes: (P, 3) camera centre in each part's frame divided by its half extents.
        q: the part.
        x, y, z: the point, likewise.
    """
    ox, oy, oz = eyes[q, 0], eyes[q, 1], eyes[q, 2]
    dx, dy, dz = x - ox, y - oy, z - oz
    length2 = dx * dx + dy * dy + dz * dz
    along = -(ox * dx + oy * dy + oz * dz) / length2
    nx, ny, nz = ox + along * dx, oy + along * dy, oz + along * dz
    gap = reaches[q] - (nx * nx + ny * ny + nz * nz)
    if gap <= 0.0:
        return False
    half = np.sqrt(gap / length2)
    low, high = along - half, min(along + half, 1.0)
    for origin, direction, taper in ((ox, dx, shapes[q, 5]), (oy, dy, shapes[q, 6]), (oz, dz, 0.0)):
        # The slab of the bounding box; most rays through the ellipsoid's rim miss the box.
        side = 1.0 + abs(taper)
        if abs(direction) < 1e-12:
            if abs(origin) > side:
                return False
            continue
        enter, leave = (-side - origin) / direction, (side - origin) / direction
        low, high = max(low, min(enter, leave)), min(high, max(enter, leave))
    if high <= low:
        return False
    for _ in range(4):
        third = (high - low) / 3.0
        s, t = low + third, high - third
        first = inside_value(shapes, q, ox + s * dx, oy + s * dy, oz + s * dz)
        if first < 1.0:
            return True
        second = inside_value(shapes, q, ox + t * dx, oy + t * dy, oz + t * dz)
        if second < 1.0:
            return True
        if first < second or (first == second and along < 0.5 * (low + high)):
            high = t
        else:
            low = s
    return False
