"""Places on parts that are followed in images: how far from there parts carry them, and the equations that bring them.

Places lie on the surface where a viewing ray met it, so they are surest across that ray.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tracker.arrays import Array, Integers, Mask
from tracker.kernels.body.wrenches import add_wrench, chained
from tracker.kernels.compilation import compiled
from tracker.kernels.projection import project_along, project_point
from tracker.kernels.rows import camera as at
from tracker.kernels.rows import carried_place as found_at


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
        cameras: (V, 29) from `Rig.packed`.
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
        cameras: (V, 29) from `Rig.packed`.
        carried: the places.
        slide_m: standard deviation of a place across its ray, for clothes slide, metres.
        found: (N, 10) output, a row each; `tracker.kernels.rows.carried_place` names the columns.
    """
    for n in range(len(carried.parts)):
        v, p = carried.views[n], carried.parts[n]
        x, y, z = _placed(placements, 0, carried, n)
        depth = project_point(cameras[v], x, y, z)[2]
        if depth <= 0.1:
            found[n] = 0.0
            found[n, found_at.VARIANCE], found[n, found_at.FACING] = 1.0, -1.0
            continue
        u, w, ux, uy, uz = project_along(cameras, v, (x, y, z), (1.0, 0.0))
        u, w, wx, wy, wz = project_along(cameras, v, (x, y, z), (0.0, 1.0))
        found[n, found_at.U], found[n, found_at.W] = u - carried.pixels[n, 0], w - carried.pixels[n, 1]
        rx, ry, rz = _turned(placements, 0, p, carried.rays, n)
        deep = (ux * rx + uy * ry + uz * rz) ** 2 + (wx * rx + wy * ry + wz * rz) ** 2
        size = ux * ux + uy * uy + uz * uz + wx * wx + wy * wy + wz * wz
        spread = 0.5 * (deep * carried.depths_m[n] ** 2 + size * slide_m**2)
        found[n, found_at.VARIANCE] = spread + carried.variances[n]
        nx, ny, nz = _turned(placements, 0, p, carried.normals, n)
        x, y, z = cameras[v, at.CENTRE_X] - x, cameras[v, at.CENTRE_Y] - y, cameras[v, at.CENTRE_Z] - z
        found[n, found_at.FACING] = (nx * x + ny * y + nz * z) / np.sqrt(x * x + y * y + z * z)
        found[n, found_at.U_X], found[n, found_at.U_Y], found[n, found_at.U_Z] = ux, uy, uz
        found[n, found_at.W_X], found[n, found_at.W_Y], found[n, found_at.W_Z] = wx, wy, wz


@compiled
def anchor_equations(
    placements: Array, carried: Carried, found: Array, weights: Array, ends: Integers, twists: Array, moves: Mask
) -> tuple[Array, Array, float, float]:
    """Normal equations that bring the places to where they are shown.

    By wrenches, see `tracker.kernels.body.wrenches`.

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
    wrenches, pulls = np.zeros((dof + 1, 6, 6)), np.zeros((dof + 1, 6))
    used = np.zeros(dof + 1, dtype=np.bool_)
    for n in range(len(carried.parts)):
        end, weight = ends[carried.parts[n]], weights[n]
        if weight <= 0.0 or end < 0:
            continue
        point = _placed(placements, 0, carried, n)
        used[end] = True
        along_u = found[n, found_at.U_X], found[n, found_at.U_Y], found[n, found_at.U_Z]
        along_w = found[n, found_at.W_X], found[n, found_at.W_Y], found[n, found_at.W_Z]
        for residual, gradient in ((found[n, found_at.U], along_u), (found[n, found_at.W], along_w)):
            add_wrench(point, gradient, residual, weight, wrenches[end], pulls[end])
            squares += weight * residual * residual
            total += weight
    matrix, vector = chained(wrenches, pulls, used, twists, moves)
    return matrix, vector, squares, total
