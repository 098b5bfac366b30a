"""Places on parts that are followed in images: how far from there parts carry them, and the equations that bring them.

Places lie on the surface where a viewing ray met it, so they are surest across that ray.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tracker.arrays import Array, Integers, Mask
from tracker.kernels.body.wrenches import add_end
from tracker.kernels.compilation import compiled
from tracker.kernels.projection import project_along, project_point
from tracker.kernels.rows import camera as at


class Carried(NamedTuple):
    """N places on parts of a scene, and where an image shows them."""

    views: Integers
    """(N,) whose image."""

    parts: Integers
    """(N,) of the scene."""

    places: Array
    """(N, 3) in the part's frame, metres."""

    normals: Array
    """(N, 3) unit vectors out of the surface, in the part's frame."""

    rays: Array
    """(N, 3) unit vectors along the ray by which the place was found, in the part's frame."""

    depths_m: Array
    """(N,) standard deviation of the place along that ray, metres."""

    pixels: Array
    """(N, 2) where the image shows it."""

    variances: Array
    """(N,) of the pixel in either axis, px^2."""


@compiled
def _turned(placements: Array, b: int, p: int, along: Array, n: int) -> tuple[float, float, float]:
    """Row n of vectors (N, 3) of part p in the world."""
    x, y, z = along[n, 0], along[n, 1], along[n, 2]
    return (
        placements[b, p, 0, 0] * x + placements[b, p, 0, 1] * y + placements[b, p, 0, 2] * z,
        placements[b, p, 1, 0] * x + placements[b, p, 1, 1] * y + placements[b, p, 1, 2] * z,
        placements[b, p, 2, 0] * x + placements[b, p, 2, 1] * y + placements[b, p, 2, 2] * z,
    )


@compiled
def _placed(placements: Array, b: int, carried: Carried, n: int) -> tuple[float, float, float]:
    """Place n in the world."""
    p = carried.parts[n]
    x, y, z = _turned(placements, b, p, carried.places, n)
    return x + placements[b, p, 0, 3], y + placements[b, p, 1, 3], z + placements[b, p, 2, 3]


@compiled
def gaps_of(placements: Array, cameras: Array, carried: Carried, most_m: float, gaps: Array) -> None:
    """How far from where they are shown poses carry the places, px; no more than a distance on the body.

    Args:
        placements: (B, P, 4, 4) world_from_part.
        cameras: (V, 25) from `Rig.packed`.
        carried: the places.
        most_m: that distance, metres; also of what lies behind the camera.
        gaps: (B, N) output.
    """
    for b in range(len(placements)):
        for n in range(len(carried.parts)):
            v = carried.views[n]
            x, y, z = _placed(placements, b, carried, n)
            u, w, depth = project_point(cameras[v], x, y, z)
            most = most_m * cameras[v, at.FX] / max(depth, 0.1)
            off = np.hypot(u - carried.pixels[n, 0], w - carried.pixels[n, 1])
            gaps[b, n] = min(off, most) if depth > 0.1 else most


@compiled
def residuals_of(placements: Array, cameras: Array, carried: Carried, slide_m: float, found: Array) -> None:
    """Where a pose carries the places, less where they are shown.

    Args:
        placements: (1, P, 4, 4) world_from_part.
        cameras: (V, 25) from `Rig.packed`.
        carried: the places.
        slide_m: standard deviation of a place across its ray, for clothes slide, metres.
        found: (N, 10) output: residual u and w, px; its variance, mean of both axes, px^2; cosine between the normal
            and the way to the camera; derivatives of u and of w by the world, px per metre. The cosine of what lies
            behind the camera is -1.
    """
    for n in range(len(carried.parts)):
        v, p = carried.views[n], carried.parts[n]
        x, y, z = _placed(placements, 0, carried, n)
        depth = project_point(cameras[v], x, y, z)[2]
        if depth <= 0.1:
            found[n] = 0.0
            found[n, 2], found[n, 3] = 1.0, -1.0
            continue
        u, w, ux, uy, uz = project_along(cameras, v, (x, y, z), (1.0, 0.0))
        u, w, wx, wy, wz = project_along(cameras, v, (x, y, z), (0.0, 1.0))
        found[n, 0], found[n, 1] = u - carried.pixels[n, 0], w - carried.pixels[n, 1]
        rx, ry, rz = _turned(placements, 0, p, carried.rays, n)
        deep = (ux * rx + uy * ry + uz * rz) ** 2 + (wx * rx + wy * ry + wz * rz) ** 2
        size = ux * ux + uy * uy + uz * uz + wx * wx + wy * wy + wz * wz
        spread = 0.5 * (deep * carried.depths_m[n] ** 2 + size * slide_m**2)
        found[n, 2] = spread + carried.variances[n]
        nx, ny, nz = _turned(placements, 0, p, carried.normals, n)
        x, y, z = cameras[v, at.CENTRE_X] - x, cameras[v, at.CENTRE_Y] - y, cameras[v, at.CENTRE_Z] - z
        found[n, 3] = (nx * x + ny * y + nz * z) / np.sqrt(x * x + y * y + z * z)
        found[n, 4], found[n, 5], found[n, 6] = ux, uy, uz
        found[n, 7], found[n, 8], found[n, 9] = wx, wy, wz


@compiled
def anchor_equations(
    placements: Array, carried: Carried, found: Array, weights: Array, ends: Integers, twists: Array, moves: Mask
) -> tuple[Array, Array, float, float]:
    """Normal equations that bring the places to where they are shown.

    As those of contours, by wrenches; see `tracker.kernels.regions.equations.shift_equations`.

    Args:
        placements: (1, P, 4, 4) world_from_part.
        carried: the places.
        found: (N, 10) from `residuals_of`.
        weights: (N,) px^-2.
        ends: (P,) last parameter that moves each part, -1 for the world; -2 for parts that do not count.
        twists: (dof, 6) spatial twists of the parameters.
        moves: (dof, dof + 1) from `BodyModel.moves`.

    Returns:
        J^T W J (dof, dof), J^T W r (dof,), sum of w r^2 and sum of w; each place has two residuals.
    """
    dof = len(twists)
    squares = total = 0.0
    matrices, vectors, wrench = np.zeros((dof + 1, 6, 6)), np.zeros((dof + 1, 6)), np.zeros(6)
    used = np.zeros(dof + 1, dtype=np.bool_)
    for n in range(len(carried.parts)):
        end, weight = ends[carried.parts[n]], weights[n]
        if weight <= 0.0 or end < 0:
            continue
        x, y, z = _placed(placements, 0, carried, n)
        used[end] = True
        for axis in range(2):
            gx, gy, gz = found[n, 4 + 3 * axis], found[n, 5 + 3 * axis], found[n, 6 + 3 * axis]
            wrench[0], wrench[1], wrench[2] = gx, gy, gz
            wrench[3], wrench[4], wrench[5] = y * gz - z * gy, z * gx - x * gz, x * gy - y * gx
            residual = found[n, axis]
            for i in range(6):
                vectors[end, i] += weight * residual * wrench[i]
                for j in range(6):
                    matrices[end, i, j] += weight * wrench[i] * wrench[j]
            squares += weight * residual * residual
            total += weight
    matrix, vector = np.zeros((dof, dof)), np.zeros(dof)
    for end in range(dof):
        if used[end]:
            add_end(matrices[end], vectors[end], twists, moves[:, end], matrix, vector)
    return matrix, vector, squares, total
