"""Parts of a body, tapered superquadrics, made ready for tests in one pose and view, and where points stand to them.

What a test needs of a part stands in one row of `tracker.kernels.rows.solid`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tracker.arrays import Array, Array32
from tracker.kernels.compilation import compiled
from tracker.kernels.projection import project_point
from tracker.kernels.rows import solid, superquadric
from tracker.kernels.rows.camera import CENTRE_X, CENTRE_Y, CENTRE_Z, FX, FY

# A Python float in a formula would make the compiled code compute it in double precision.
_HALF: Any = np.float32(0.5)
_ONE: Any = np.float32(1.0)
_TWO: Any = np.float32(2.0)
_OUTSIDE: Any = np.float32(9.0)


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
        place_solid(placements, b, p, shapes, bounds, solids)


@compiled(fastmath={"contract", "nsz"})
def place_solid(placements: Array, b: int, p: int, shapes: Array, bounds: Array, solids: Array32) -> None:
    """The same for part p alone."""
    for r in range(3):
        shift, inverse = 0.0, 1.0 / shapes[p, r]
        for k in range(3):
            solids[p, solid.M11 + 4 * r + k] = placements[b, p, k, r] * inverse
            solids[p, solid.R11 + 3 * r + k] = placements[b, p, r, k]
            shift -= placements[b, p, k, r] * placements[b, p, k, 3]
        solids[p, solid.MX + 4 * r] = shift * inverse
        solids[p, solid.X + r] = placements[b, p, r, 3]
    e1, e2 = shapes[p, superquadric.E1], shapes[p, superquadric.E2]
    solids[p, solid.REACH], solids[p, solid.K1], solids[p, solid.K2] = (
        bounds[1, p],
        shapes[p, superquadric.K1],
        shapes[p, superquadric.K2],
    )
    solids[p, solid.AROUND], solids[p, solid.ALONG], solids[p, solid.UPWARD] = 2.0 / e2, e2 / e1, 2.0 / e1


@compiled(fastmath={"contract", "nsz"})
def view_solids(shapes: Array, bounds: Array, camera: Array, margin_m: float, solids: Array32) -> None:
    """Fills the columns of `solids` that depend on the view.

    Args:
        shapes, bounds: as in `place_solids`.
        camera: (29,) row of `Rig.packed`.
        margin_m: added to the width of a part in the image, metres.
        solids: (P, 48) in and out.
    """
    for p in range(len(shapes)):
        view_solid(shapes, bounds, camera, margin_m, p, solids)


@compiled(fastmath={"contract", "nsz"})
def view_solid(shapes: Array, bounds: Array, camera: Array, margin_m: float, p: int, solids: Array32) -> None:
    """The same for part p alone."""
    for r in range(3):
        solids[p, solid.EYE_X + r] = (
            solids[p, solid.M11 + 4 * r] * camera[CENTRE_X]
            + solids[p, solid.M12 + 4 * r] * camera[CENTRE_Y]
            + solids[p, solid.M13 + 4 * r] * camera[CENTRE_Z]
            + solids[p, solid.MX + 4 * r]
        )
        solids[p, solid.CAMERA_X + r] = solids[p, solid.EYE_X + r] * shapes[p, r]
    x, y, z, half = solids[p, solid.X], solids[p, solid.Y], solids[p, solid.Z], shapes[p, superquadric.A3]
    ax, ay, az = half * solids[p, solid.R13], half * solids[p, solid.R23], half * solids[p, solid.R33]
    u0, v0, d0 = project_point(camera, x - ax, y - ay, z - az)
    u1, v1, d1 = project_point(camera, x + ax, y + ay, z + az)
    width = bounds[2, p] + margin_m
    depth = min(d0, d1) - width
    du, dv = u1 - u0, v1 - v0
    square = du * du + dv * dv + 1e-9
    solids[p, solid.START_U], solids[p, solid.START_V], solids[p, solid.SHARE_U], solids[p, solid.SHARE_V] = (
        u0,
        v0,
        du / square,
        dv / square,
    )
    solids[p, solid.AXIS_U], solids[p, solid.AXIS_V] = du, dv
    # Off the axis of a camera a width is drawn out by the ratio of distance and depth; else a tenth on top covers
    # perspective and lens distortion across the width of a part.
    drawn_out = 1.1
    if depth > 0.05:
        cx, cy, cz = x - camera[CENTRE_X], y - camera[CENTRE_Y], z - camera[CENTRE_Z]
        drawn_out = max(drawn_out, np.sqrt((cx - ax) ** 2 + (cy - ay) ** 2 + (cz - az) ** 2) / d0)
        drawn_out = max(drawn_out, np.sqrt((cx + ax) ** 2 + (cy + ay) ** 2 + (cz + az) ** 2) / d1)
    wide = drawn_out * max(camera[FX], camera[FY]) * width / max(depth, 0.05)
    solids[p, solid.WIDTH2] = wide * wide
    solids[p, solid.LEAST_U], solids[p, solid.MOST_U] = min(u0, u1) - wide, max(u0, u1) + wide
    solids[p, solid.LEAST_V], solids[p, solid.MOST_V] = min(v0, v1) - wide, max(v0, v1) + wide
    solids[p, solid.NEAREST] = depth if depth > 0.05 else -1.0


@compiled(fastmath={"contract", "nsz"})
def in_part(solids: Array | Array32, q: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A world point in the frame of part q, in units of its half extents."""
    return (
        solids[q, solid.M11] * x + solids[q, solid.M12] * y + solids[q, solid.M13] * z + solids[q, solid.MX],
        solids[q, solid.M21] * x + solids[q, solid.M22] * y + solids[q, solid.M23] * z + solids[q, solid.MY],
        solids[q, solid.M31] * x + solids[q, solid.M32] * y + solids[q, solid.M33] * z + solids[q, solid.MZ],
    )


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
    u = abs(x / (_ONE + solids[q, solid.K1] * z))
    v = abs(y / (_ONE + solids[q, solid.K2] * z))
    if u > _ONE or v > _ONE:
        return _OUTSIDE
    square = u * u + v * v
    if square + z * z < _ONE:
        return _HALF
    if solids[q, solid.AROUND] == _TWO:
        if square > _ONE:
            return _OUTSIDE
        around = square ** (_HALF * solids[q, solid.UPWARD])
    else:
        around = (u ** solids[q, solid.AROUND] + v ** solids[q, solid.AROUND]) ** solids[q, solid.ALONG]
    return around + abs(z) ** solids[q, solid.UPWARD]
