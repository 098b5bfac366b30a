"""Which parts cover or touch a contour sample: ray tests against tapered superquadrics.

What a test needs of a part stands in one row of one array, `solids` (P, 48): numba passes an array by its nine
words, and slices cost a reference count, so that several arrays or slices would be most of the time of a test.
Single precision is good to 5 micrometres in a room and takes half the time.

Columns: 0-11 motion (3x4) from the world into the part's frame in units of its half extents; 12-14 camera centre
in that frame; 15 largest squared distance of the surface from the origin there; 16-17 taper; 18-20 exponents 2/e2,
e2/e1 and 2/e1; 21-28 the part in the image: 21-22 one end of its axis, px, 23-24 the axis divided by its squared
length, 25-26 the axis, 27 the squared width around it, 28 the nearest depth, metres, -1 for a part that is not wholly
before the camera; 29-37 rotation and 38-40 position of the part in the world; 41-43 camera centre in the part's
frame, metres; 44-47 the box around the part in the image: least and largest u and v, px.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tracker.arrays import Array, Array32, Integers, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.projection import project_point

SOLID_COLUMNS = 48

ROW = 1040
"""Room for crossings or samples of one part. Numbers of one kind stand in rows of this length of one flat array: only
so does the compiler see that they are apart, and computes eight at a time. Not a multiple of 1024, or all rows would
share their cache lines."""

_ZERO: Any = np.float32(0.0)
_HALF: Any = np.float32(0.5)
_ONE: Any = np.float32(1.0)
_TWO: Any = np.float32(2.0)
_FOUR: Any = np.float32(4.0)
_OUTSIDE: Any = np.float32(9.0)
_HUGE: Any = np.float32(1e30)

SPOT_ROWS = 17
"""Rows of the samples of one part: 0-1 pixel, 2-3 image normal, 4 contour length, 5-7 world point, 8-10 world normal,
11 what other parts do to it: 0 nothing, 1 touch, 2 cover; 12-16 see `_approach`."""


@compiled
def whole_blocks(n: int) -> int:
    """N rounded up to what the compiled code handles at a time; one by one, the rest would take most of the time."""
    return (n + 31) & ~31


@compiled(fastmath={"contract", "nsz"})
def place_solids(placements: Array, b: int, shapes: Array, bounds: Array, solids: Array32) -> None:
    """Fills the columns of `solids` that depend on the pose b alone.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres.
        b: the pose.
        shapes: (P, 7) packed superquadrics.
        bounds: (3, P) radii of bounding spheres, metres; reaches of bounding ellipsoids, squared, in units of the
            half extents; largest distances of the surface from the z axis, metres.
        solids: (P, 48) output.
    """
    for p in range(len(shapes)):
        for r in range(3):
            shift, inverse = 0.0, 1.0 / shapes[p, r]
            for k in range(3):
                solids[p, 4 * r + k] = placements[b, p, k, r] * inverse
                solids[p, 29 + 3 * r + k] = placements[b, p, r, k]
                shift -= placements[b, p, k, r] * placements[b, p, k, 3]
            solids[p, 4 * r + 3] = shift * inverse
            solids[p, 38 + r] = placements[b, p, r, 3]
        e1, e2 = shapes[p, 3], shapes[p, 4]
        solids[p, 15], solids[p, 16], solids[p, 17] = bounds[1, p], shapes[p, 5], shapes[p, 6]
        solids[p, 18], solids[p, 19], solids[p, 20] = 2.0 / e2, e2 / e1, 2.0 / e1


@compiled(fastmath={"contract", "nsz"})
def view_solids(shapes: Array, bounds: Array, camera: Array, margin_m: float, solids: Array32) -> None:
    """Fills the columns of `solids` that depend on the view.

    Args:
        shapes, bounds: as in `place_solids`.
        camera: (25,) row of `Rig.packed`.
        margin_m: added to the width of a part in the image, metres.
        solids: (P, 48) in and out.
    """
    for p in range(len(shapes)):
        for r in range(3):
            solids[p, 12 + r] = (
                solids[p, 4 * r] * camera[12]
                + solids[p, 4 * r + 1] * camera[13]
                + solids[p, 4 * r + 2] * camera[14]
                + solids[p, 4 * r + 3]
            )
            solids[p, 41 + r] = solids[p, 12 + r] * shapes[p, r]
        x, y, z, half = solids[p, 38], solids[p, 39], solids[p, 40], shapes[p, 2]
        ax, ay, az = half * solids[p, 31], half * solids[p, 34], half * solids[p, 37]
        u0, v0, d0 = project_point(camera, x - ax, y - ay, z - az)
        u1, v1, d1 = project_point(camera, x + ax, y + ay, z + az)
        width = bounds[2, p] + margin_m
        depth = min(d0, d1) - width
        du, dv = u1 - u0, v1 - v0
        square = du * du + dv * dv + 1e-9
        solids[p, 21], solids[p, 22], solids[p, 23], solids[p, 24] = u0, v0, du / square, dv / square
        solids[p, 25], solids[p, 26] = du, dv
        # A tenth on top covers perspective and lens distortion across the width of a part.
        wide = 1.1 * camera[15] * width / max(depth, 0.05)
        solids[p, 27] = wide * wide
        solids[p, 44], solids[p, 45] = min(u0, u1) - wide, max(u0, u1) + wide
        solids[p, 46], solids[p, 47] = min(v0, v1) - wide, max(v0, v1) + wide
        solids[p, 28] = depth if depth > 0.05 else -1.0


@compiled(fastmath={"contract", "nsz"})
def beside(solids: Array32, q: int, u: float, v: float) -> float:
    """Squared distance of a pixel from the axis of part q, px^2."""
    x, y = u - solids[q, 21], v - solids[q, 22]
    t = min(max(x * solids[q, 23] + y * solids[q, 24], 0.0), 1.0)
    x, y = x - t * solids[q, 25], y - t * solids[q, 26]
    return x * x + y * y


@compiled
def neighbours(p: int, solids: Array32, covering: Mask, radius: float, listed: Integers) -> int:
    """Those of some parts that may cover or touch part p, which lies in a sphere of that radius; their number.

    In the image both are axes with a width. Axes that cross are near; else the least distance is at an end of one.
    """
    n = 0
    u0, v0, du, dv = solids[p, 21], solids[p, 22], solids[p, 25], solids[p, 26]
    own = np.sqrt(solids[p, 27])
    for q in range(len(solids)):
        if not covering[q] or solids[q, 44] > solids[p, 45] or solids[q, 45] < solids[p, 44]:
            continue
        if solids[q, 46] > solids[p, 47] or solids[q, 47] < solids[p, 46]:
            continue
        if q == p or solids[q, 28] < 0.0 or solids[q, 28] > solids[p, 28] + 2.0 * radius + 0.1:
            continue
        x, y, eu, ev = solids[q, 21] - u0, solids[q, 22] - v0, solids[q, 25], solids[q, 26]
        near = (own + np.sqrt(solids[q, 27])) ** 2
        cross = du * ev - dv * eu
        along_own, along_other = x * ev - y * eu, x * dv - y * du
        if cross < 0.0:
            cross, along_own, along_other = -cross, -along_own, -along_other
        if (
            (0.0 <= along_own <= cross and 0.0 <= along_other <= cross)
            or beside(solids, q, u0, v0) < near
            or beside(solids, q, u0 + du, v0 + dv) < near
            or beside(solids, p, u0 + x, v0 + y) < near
            or beside(solids, p, u0 + x + eu, v0 + y + ev) < near
        ):
            listed[n] = q
            n += 1
    return n


@compiled(fastmath={"contract", "nsz", "arcp"})
def inside_value(solids: Array32, q: int, x: float, y: float, z: float) -> float:
    """Inside-outside function of part q at a point in units of its half extents.

    Args:
        solids: (P, 48) parts with exponents e1, e2 up to 1.
        q: the part.
        x, y, z: position in the part's frame divided by a1, a2, a3.

    Returns:
        Below 1 inside, 1 on the surface; 9 outside the bounding box and 0.5 inside the inscribed ellipsoid,
        both without evaluating powers.
    """
    if abs(z) > _ONE:
        return _OUTSIDE
    u = abs(x / (_ONE + solids[q, 16] * z))
    v = abs(y / (_ONE + solids[q, 17] * z))
    if u > _ONE or v > _ONE:
        return _OUTSIDE
    square = u * u + v * v
    if square + z * z < _ONE:
        return _HALF
    if solids[q, 18] == _TWO:
        if square > _ONE:
            return _OUTSIDE
        around = square ** (_HALF * solids[q, 20])
    else:
        around = (u ** solids[q, 18] + v ** solids[q, 18]) ** solids[q, 19]
    return around + abs(z) ** solids[q, 20]


@compiled(fastmath={"contract", "nsz", "arcp"})
def _clipped(origin: float, direction: float, side: float, low: float, high: float) -> tuple[float, float]:
    """What is left of a ray between low and high inside the slab from -side to side."""
    inverse = _ONE / direction if direction != _ZERO else _HUGE
    enter, leave = (-side - origin) * inverse, (side - origin) * inverse
    return max(low, min(enter, leave)), min(high, max(enter, leave))


@compiled(fastmath={"contract", "nsz", "arcp"})
def blocks_ray(solids: Array32, q: int, x: float, y: float, z: float) -> bool:
    """Whether part q covers a point seen from a camera.

    The ray is clipped to the part's bounding ellipsoid and box. Where it comes nearest to the centre, in units of
    the half extents, the inside-outside function is close to its least value along the ray; there and half-way
    to both ends of what is left of the ray it is evaluated.

    Args:
        solids: (P, 48) parts.
        q: the part.
        x, y, z: the point in the part's frame divided by a1, a2, a3.
    """
    ox, oy, oz = solids[q, 12], solids[q, 13], solids[q, 14]
    dx, dy, dz = x - ox, y - oy, z - oz
    length2 = dx * dx + dy * dy + dz * dz
    along = -(ox * dx + oy * dy + oz * dz) / length2
    nx, ny, nz = ox + along * dx, oy + along * dy, oz + along * dz
    gap = solids[q, 15] - (nx * nx + ny * ny + nz * nz)
    if gap <= _ZERO:
        return False
    half = np.sqrt(gap / length2)
    low, high = along - half, min(along + half, _ONE)
    if high <= low:
        return False
    low, high = _clipped(ox, dx, _ONE + abs(solids[q, 16]), low, high)
    low, high = _clipped(oy, dy, _ONE + abs(solids[q, 17]), low, high)
    low, high = _clipped(oz, dz, _ONE, low, high)
    if high <= low:
        return False
    middle = min(max(along, low), high)
    if inside_value(solids, q, ox + middle * dx, oy + middle * dy, oz + middle * dz) < _ONE:
        return True
    t = _HALF * (low + middle)
    if inside_value(solids, q, ox + t * dx, oy + t * dy, oz + t * dz) < _ONE:
        return True
    t = _HALF * (middle + high)
    return inside_value(solids, q, ox + t * dx, oy + t * dy, oz + t * dz) < _ONE


@compiled(fastmath={"contract", "nsz", "nnan", "ninf"})
def _approach(solids: Array32, q: int, spots: Array32, n: int) -> None:
    """How n samples stand to part q: fills the rows 12-16 of `spots`, eight samples at a time.

    12-14 are the position in the part's frame in units of its half extents; 15 by how much the viewing ray comes
    nearer than the part's bounding ellipsoid, squared, -1 where the pixel is too far from the part's axis; 16 by how
    much the sample lies within twice that ellipsoid, squared.
    """
    u0, v0, wide = solids[q, 21], solids[q, 22], solids[q, 27]
    tu, tv = solids[q, 23], solids[q, 24]
    du, dv = solids[q, 25], solids[q, 26]
    a0, a1, a2, a3 = (solids[q, 0], solids[q, 1], solids[q, 2], solids[q, 3])
    b0, b1, b2, b3 = (solids[q, 4], solids[q, 5], solids[q, 6], solids[q, 7])
    c0, c1, c2, c3 = (solids[q, 8], solids[q, 9], solids[q, 10], solids[q, 11])
    ox, oy, oz = solids[q, 12], solids[q, 13], solids[q, 14]
    reach = solids[q, 15]
    for i in range(whole_blocks(n)):
        x, y = spots[i] - u0, spots[ROW + i] - v0
        t = min(max(x * tu + y * tv, _ZERO), _ONE)
        x, y = x - t * du, y - t * dv
        beyond = x * x + y * y - wide
        wx, wy, wz = spots[5 * ROW + i], spots[6 * ROW + i], spots[7 * ROW + i]
        x = a0 * wx + a1 * wy + a2 * wz + a3
        y = b0 * wx + b1 * wy + b2 * wz + b3
        z = c0 * wx + c1 * wy + c2 * wz + c3
        spots[12 * ROW + i], spots[13 * ROW + i], spots[14 * ROW + i] = x, y, z
        spots[16 * ROW + i] = _FOUR * reach - (x * x + y * y + z * z) if beyond < _ZERO else -_ONE
        dx, dy, dz = x - ox, y - oy, z - oz
        cx, cy, cz = oy * dz - oz * dy, oz * dx - ox * dz, ox * dy - oy * dx
        gap = reach - (cx * cx + cy * cy + cz * cz) / (dx * dx + dy * dy + dz * dz)
        spots[15 * ROW + i] = gap if beyond < _ZERO else -_ONE


@compiled(fastmath={"contract", "nsz"})
def cover(solids: Array32, q: int, contact_m: float, spots: Array32, n: int) -> None:
    """Marks the contour samples of another part that part q covers (2) or touches on their outer side (1).

    Args:
        solids: (P, 48) parts in the view.
        q: the part.
        contact_m: distance at which parts touch, metres.
        spots: samples, see `SPOT_ROWS`; marked in row 11.
        n: their number.
    """
    _approach(solids, q, spots, n)
    apart = np.float32(contact_m)
    for i in range(n):
        meets, near = spots[15 * ROW + i] > _ZERO, spots[16 * ROW + i] > _ZERO
        if not (meets or near) or spots[11 * ROW + i] == _TWO:
            continue
        x, y, z = spots[12 * ROW + i], spots[13 * ROW + i], spots[14 * ROW + i]
        if meets and blocks_ray(solids, q, x, y, z):
            spots[11 * ROW + i] = 2.0
        elif near and spots[11 * ROW + i] == _ZERO:
            nx, ny, nz = spots[8 * ROW + i], spots[9 * ROW + i], spots[10 * ROW + i]
            ox = x + apart * (solids[q, 0] * nx + solids[q, 1] * ny + solids[q, 2] * nz)
            oy = y + apart * (solids[q, 4] * nx + solids[q, 5] * ny + solids[q, 6] * nz)
            oz = z + apart * (solids[q, 8] * nx + solids[q, 9] * ny + solids[q, 10] * nz)
            if inside_value(solids, q, ox, oy, oz) < _ONE:
                spots[11 * ROW + i] = 1.0
