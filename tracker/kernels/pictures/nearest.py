"""Which of the parts before a camera is the nearest, pixel by pixel: a small depth buffer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tracker.arrays import Array, Array32, Integers
from tracker.kernels.compilation import compiled
from tracker.kernels.projection import project_point

_NEAREST_M = 0.05
"""Parts that come closer to the camera than this are not drawn, metres."""


@compiled
def project_surfaces(placements: Array, surfaces: Array, camera: Array, seen: Array) -> None:
    """Images of the points of parts.

    Args:
        placements: (P, 4, 4) world_from_part, metres.
        surfaces: (P, N, 3) points in the parts' frames, metres.
        camera: (25,) row of `Rig.packed`.
        seen: (P, N, 3) output: pixel and inverse depth, 1 / m; NaN for parts that are not wholly before the camera.
    """
    for p in range(len(placements)):
        nearest = np.inf
        for i in range(surfaces.shape[1]):
            x, y, z = surfaces[p, i, 0], surfaces[p, i, 1], surfaces[p, i, 2]
            wx = placements[p, 0, 0] * x + placements[p, 0, 1] * y + placements[p, 0, 2] * z + placements[p, 0, 3]
            wy = placements[p, 1, 0] * x + placements[p, 1, 1] * y + placements[p, 1, 2] * z + placements[p, 1, 3]
            wz = placements[p, 2, 0] * x + placements[p, 2, 1] * y + placements[p, 2, 2] * z + placements[p, 2, 3]
            seen[p, i, 0], seen[p, i, 1], depth = project_point(camera, wx, wy, wz)
            seen[p, i, 2] = 1.0 / depth
            nearest = min(nearest, depth)
        if nearest < _NEAREST_M:
            seen[p] = np.nan


@compiled
def draw_nearest(
    seen: Array, triangles: Integers, corner: tuple[int, int], depths: Array32, parts: NDArray[np.int16]
) -> None:
    """Draws the sides of parts that face the camera; inverse depths are linear in the image but for the lens.

    Args:
        seen: (P, N, 3) from `project_surfaces`.
        triangles: (T, 3) point numbers, anticlockwise seen from outside.
        corner: x, y of the pictures' first pixel in the image.
        depths: (h, w) in and out: inverse depth, 1 / m, 0 where there is nothing.
        parts: (h, w) in and out: number of the part.
    """
    for p in range(len(seen)):
        if np.isnan(seen[p, 0, 2]):
            continue
        for t in range(len(triangles)):
            i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            ax, ay, az = seen[p, i, 0] - corner[0], seen[p, i, 1] - corner[1], seen[p, i, 2]
            bx, by, bz = seen[p, j, 0] - corner[0], seen[p, j, 1] - corner[1], seen[p, j, 2]
            cx, cy, cz = seen[p, k, 0] - corner[0], seen[p, k, 1] - corner[1], seen[p, k, 2]
            area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
            if area < 0.0:  # y goes down in images: what is anticlockwise there is turned away
                along_x = ((bz - az) * (cy - ay) - (cz - az) * (by - ay)) / area
                along_y = ((cz - az) * (bx - ax) - (bz - az) * (cx - ax)) / area
                # from top to bottom
                if by < ay:
                    ax, ay, az, bx, by, bz = bx, by, bz, ax, ay, az
                if cy < by:
                    bx, by, cx, cy = cx, cy, bx, by
                    if by < ay:
                        ax, ay, bx, by = bx, by, ax, ay
                base = seen[p, i, 2] - along_x * (seen[p, i, 0] - corner[0]) - along_y * (seen[p, i, 1] - corner[1])
                _draw(ax, ay, bx, by, cx, cy, (base, along_x, along_y), p, depths, parts)


@compiled
def _draw(
    ax: float,
    ay: float,
    bx: float,
    by: float,
    cx: float,
    cy: float,
    plane: tuple[float, float, float],
    part: int,
    depths: Array32,
    parts: NDArray[np.int16],
) -> None:
    height, width = depths.shape
    base, along_x, along_y = plane
    whole = (cx - ax) / max(cy - ay, 1e-9)
    upper, lower = (bx - ax) / max(by - ay, 1e-9), (cx - bx) / max(cy - by, 1e-9)
    for y in range(max(int(np.ceil(ay)), 0), min(int(np.floor(cy)), height - 1) + 1):
        one = ax + whole * (y - ay)
        other = ax + upper * (y - ay) if y < by else bx + lower * (y - by)
        first, last = max(int(np.ceil(min(one, other))), 0), min(int(np.floor(max(one, other))), width - 1)
        for x in range(first, last + 1):
            inverse = base + along_x * x + along_y * y
            if inverse > depths[y, x]:
                depths[y, x] = inverse
                parts[y, x] = part
