"""Which of the parts before a camera is the nearest, pixel by pixel: a small depth buffer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tracker.arrays import Array, Array32, Integers, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.pictures.silhouettes import NEAREST_M
from tracker.kernels.projection import project_grid

_LEVEL_PX = 1e-9
"""Sides that rise by less are level: no row lies between their ends."""


@compiled
def project_surfaces(placements: Array, surfaces: Array, wanted: Mask, camera: Array, seen: Array) -> None:
    """Images of the points of parts.

    Args:
        placements: (P, 4, 4) world_from_part, metres.
        surfaces: (P, N, 3) points in the parts' frames, metres.
        wanted: (P,) parts that are meant.
        camera: (29,) row of `Rig.packed`.
        seen: (P, 3, N) output: pixels and inverse depths, 1 / m; NaN for parts that are not meant, or not wholly before
            the camera.
    """
    for p in range(len(placements)):
        if not wanted[p] or project_grid(placements[p], surfaces[p], camera, seen[p]) < NEAREST_M:
            seen[p] = np.nan
        else:
            seen[p, 2] = 1.0 / seen[p, 2]


@compiled
def draw_nearest(
    seen: Array, triangles: Integers, corner: tuple[int, int], depths: Array32, parts: NDArray[np.int16]
) -> None:
    """Draws the sides of parts that face the camera; inverse depths are linear in the image but for the lens.

    Args:
        seen: (P, 3, N) from `project_surfaces`.
        triangles: (T, 3) point numbers, anticlockwise seen from outside.
        corner: x, y of the pictures' first pixel in the image.
        depths: (h, w) in and out: inverse depth, 1 / m, 0 where there is nothing.
        parts: (h, w) in and out: number of the part.
    """
    for p in range(len(seen)):
        if np.isnan(seen[p, 0, 0]):
            continue
        for t in range(len(triangles)):
            i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            ax, ay, az = seen[p, 0, i] - corner[0], seen[p, 1, i] - corner[1], seen[p, 2, i]
            bx, by, bz = seen[p, 0, j] - corner[0], seen[p, 1, j] - corner[1], seen[p, 2, j]
            cx, cy, cz = seen[p, 0, k] - corner[0], seen[p, 1, k] - corner[1], seen[p, 2, k]
            area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
            if area < 0.0:  # y goes down in images: what is anticlockwise there is turned away
                along_x = ((bz - az) * (cy - ay) - (cz - az) * (by - ay)) / area
                along_y = ((cz - az) * (bx - ax) - (bz - az) * (cx - ax)) / area
                plane = az - along_x * ax - along_y * ay, along_x, along_y
                # from top to bottom
                if by < ay:
                    ax, ay, bx, by = bx, by, ax, ay
                if cy < by:
                    bx, by, cx, cy = cx, cy, bx, by
                    if by < ay:
                        ax, ay, bx, by = bx, by, ax, ay
                _draw((ax, bx, cx), (ay, by, cy), plane, p, depths, parts)


@compiled
def _draw(
    xs: tuple[float, float, float],
    ys: tuple[float, float, float],
    plane: tuple[float, float, float],
    part: int,
    depths: Array32,
    parts: NDArray[np.int16],
) -> None:
    """Draws a triangle row by row.

    Args:
        xs, ys: its corners in the pictures, from top to bottom, px.
        plane: inverse depth at the pictures' first pixel, and by how much it grows per px along x and y, 1 / m.
        part: its number.
        depths, parts: as for `draw_nearest`.
    """
    height, width = depths.shape
    (ax, bx, cx), (ay, by, cy), (base, along_x, along_y) = xs, ys, plane
    whole = (cx - ax) / max(cy - ay, _LEVEL_PX)
    upper, lower = (bx - ax) / max(by - ay, _LEVEL_PX), (cx - bx) / max(cy - by, _LEVEL_PX)
    for y in range(max(int(np.ceil(ay)), 0), min(int(np.floor(cy)), height - 1) + 1):
        one = ax + whole * (y - ay)
        other = ax + upper * (y - ay) if y < by else bx + lower * (y - by)
        first, last = max(int(np.ceil(min(one, other))), 0), min(int(np.floor(max(one, other))), width - 1)
        for x in range(first, last + 1):
            inverse = np.float32(base + along_x * x + along_y * y)
            # of two parts in one place the first one, in whatever order they are drawn
            if inverse > depths[y, x] or (inverse == depths[y, x] and part < parts[y, x]):
                depths[y, x] = inverse
                parts[y, x] = part
