"""Which parts cover or touch a contour sample: ray tests against tapered superquadrics.

Parts near one another in the image are told by their axes (`neighbours`); only those are tested. The parts are made
ready by `tracker.kernels.contours.solids`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tracker.arrays import Array32, Integers, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.contours.solids import inside_value
from tracker.kernels.rows import solid, spot
from tracker.kernels.rows.workspace import BLOCK

# A Python float in a formula would make the compiled code compute it in double precision.
_ZERO: Any = np.float32(0.0)
_HALF: Any = np.float32(0.5)
_ONE: Any = np.float32(1.0)
_TWO: Any = np.float32(2.0)
_FOUR: Any = np.float32(4.0)
_HUGE: Any = np.float32(1e30)


@compiled
def whole_blocks(n: int) -> int:
    """N rounded up to what the compiled code handles at a time; one by one, the rest would take most of the time."""
    return (n + BLOCK - 1) & ~(BLOCK - 1)


@compiled(fastmath={"contract", "nsz"})
def beside(solids: Array32, q: int, u: float, v: float) -> float:
    """Squared distance of a pixel from the axis of part q, px^2."""
    x, y = u - solids[q, solid.START_U], v - solids[q, solid.START_V]
    t = min(max(x * solids[q, solid.SHARE_U] + y * solids[q, solid.SHARE_V], 0.0), 1.0)
    x, y = x - t * solids[q, solid.AXIS_U], y - t * solids[q, solid.AXIS_V]
    return x * x + y * y


@compiled
def neighbours(p: int, solids: Array32, covering: Mask, radius: float, listed: Integers) -> int:
    """Those of some parts that may cover or touch part p, which lies in a sphere of that radius; their number.

    In the image both are axes with a width. Axes that cross are near; else the least distance is at an end of one.
    """
    n = 0
    u0, v0, du, dv = (
        solids[p, solid.START_U],
        solids[p, solid.START_V],
        solids[p, solid.AXIS_U],
        solids[p, solid.AXIS_V],
    )
    own = np.sqrt(solids[p, solid.WIDTH2])
    for q in range(len(solids)):
        if (
            not covering[q]
            or solids[q, solid.LEAST_U] > solids[p, solid.MOST_U]
            or solids[q, solid.MOST_U] < solids[p, solid.LEAST_U]
        ):
            continue
        if solids[q, solid.LEAST_V] > solids[p, solid.MOST_V] or solids[q, solid.MOST_V] < solids[p, solid.LEAST_V]:
            continue
        if (
            q == p
            or solids[q, solid.NEAREST] < 0.0
            or solids[q, solid.NEAREST] > solids[p, solid.NEAREST] + 2.0 * radius + 0.1
        ):
            continue
        x, y, eu, ev = (
            solids[q, solid.START_U] - u0,
            solids[q, solid.START_V] - v0,
            solids[q, solid.AXIS_U],
            solids[q, solid.AXIS_V],
        )
        near = (own + np.sqrt(solids[q, solid.WIDTH2])) ** 2
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
    ox, oy, oz = solids[q, solid.EYE_X], solids[q, solid.EYE_Y], solids[q, solid.EYE_Z]
    dx, dy, dz = x - ox, y - oy, z - oz
    length2 = dx * dx + dy * dy + dz * dz
    along = -(ox * dx + oy * dy + oz * dz) / length2
    nx, ny, nz = ox + along * dx, oy + along * dy, oz + along * dz
    gap = solids[q, solid.REACH] - (nx * nx + ny * ny + nz * nz)
    if gap <= _ZERO:
        return False
    half = np.sqrt(gap / length2)
    low, high = along - half, min(along + half, _ONE)
    if high <= low:
        return False
    low, high = _clipped(ox, dx, _ONE + abs(solids[q, solid.K1]), low, high)
    low, high = _clipped(oy, dy, _ONE + abs(solids[q, solid.K2]), low, high)
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
    u0, v0, wide = solids[q, solid.START_U], solids[q, solid.START_V], solids[q, solid.WIDTH2]
    tu, tv = solids[q, solid.SHARE_U], solids[q, solid.SHARE_V]
    du, dv = solids[q, solid.AXIS_U], solids[q, solid.AXIS_V]
    a0, a1, a2, a3 = (solids[q, solid.M11], solids[q, solid.M12], solids[q, solid.M13], solids[q, solid.MX])
    b0, b1, b2, b3 = (solids[q, solid.M21], solids[q, solid.M22], solids[q, solid.M23], solids[q, solid.MY])
    c0, c1, c2, c3 = (solids[q, solid.M31], solids[q, solid.M32], solids[q, solid.M33], solids[q, solid.MZ])
    ox, oy, oz = solids[q, solid.EYE_X], solids[q, solid.EYE_Y], solids[q, solid.EYE_Z]
    reach = solids[q, solid.REACH]
    for i in range(whole_blocks(n)):
        x, y = spots[spot.U + i] - u0, spots[spot.V + i] - v0
        t = min(max(x * tu + y * tv, _ZERO), _ONE)
        x, y = x - t * du, y - t * dv
        beyond = x * x + y * y - wide
        wx, wy, wz = spots[spot.X + i], spots[spot.Y + i], spots[spot.Z + i]
        x = a0 * wx + a1 * wy + a2 * wz + a3
        y = b0 * wx + b1 * wy + b2 * wz + b3
        z = c0 * wx + c1 * wy + c2 * wz + c3
        spots[spot.LOCAL_X + i], spots[spot.LOCAL_Y + i], spots[spot.LOCAL_Z + i] = x, y, z
        spots[spot.NEAR + i] = _FOUR * reach - (x * x + y * y + z * z) if beyond < _ZERO else -_ONE
        dx, dy, dz = x - ox, y - oy, z - oz
        cx, cy, cz = oy * dz - oz * dy, oz * dx - ox * dz, ox * dy - oy * dx
        gap = reach - (cx * cx + cy * cy + cz * cz) / (dx * dx + dy * dy + dz * dz)
        spots[spot.MEETS + i] = gap if beyond < _ZERO else -_ONE


@compiled(fastmath={"contract", "nsz"})
def cover(solids: Array32, q: int, contact_m: float, spots: Array32, n: int) -> None:
    """Marks the contour samples of another part that part q covers (2) or touches on their outer side (1).

    Args:
        solids: (P, 48) parts in the view.
        q: the part.
        contact_m: distance at which parts touch, metres.
        spots: samples, see `tracker.kernels.rows.spot`; their state is marked.
        n: their number.
    """
    _approach(solids, q, spots, n)
    apart = np.float32(contact_m)
    for i in range(n):
        meets, near = spots[spot.MEETS + i] > _ZERO, spots[spot.NEAR + i] > _ZERO
        if not (meets or near) or spots[spot.STATE + i] == _TWO:
            continue
        x, y, z = spots[spot.LOCAL_X + i], spots[spot.LOCAL_Y + i], spots[spot.LOCAL_Z + i]
        if meets and blocks_ray(solids, q, x, y, z):
            spots[spot.STATE + i] = 2.0
        elif near and spots[spot.STATE + i] == _ZERO:
            nx, ny, nz = spots[spot.NX + i], spots[spot.NY + i], spots[spot.NZ + i]
            ox = x + apart * (solids[q, solid.M11] * nx + solids[q, solid.M12] * ny + solids[q, solid.M13] * nz)
            oy = y + apart * (solids[q, solid.M21] * nx + solids[q, solid.M22] * ny + solids[q, solid.M23] * nz)
            oz = z + apart * (solids[q, solid.M31] * nx + solids[q, solid.M32] * ny + solids[q, solid.M33] * nz)
            if inside_value(solids, q, ox, oy, oz) < _ONE:
                spots[spot.STATE + i] = 1.0
