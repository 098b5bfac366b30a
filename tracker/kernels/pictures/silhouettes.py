"""The region of an image that convex parts cover."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Array32, Integers, Mask
from tracker.kernels.bits import lowest_bit
from tracker.kernels.compilation import compiled
from tracker.kernels.projection import project_point
from tracker.kernels.rows import camera as at

NEAREST_M = 0.05
"""Parts that come closer to the camera than this are not drawn, metres."""


@compiled
def widen(u0: float, v0: float, u1: float, v1: float, extents: Array) -> None:
    """Widens the extents (2, h) of the pixel rows that a line crosses to where it crosses them."""
    if v1 < v0:
        u0, v0, u1, v1 = u1, v1, u0, v0
    first, last = max(int(np.ceil(v0)), 0), min(int(np.floor(v1)), extents.shape[1] - 1)
    slope = (u1 - u0) / (v1 - v0) if v1 > v0 else 0.0
    for row in range(first, last + 1):
        u = u0 + slope * (row - v0)
        extents[0, row] = min(extents[0, row], u)
        extents[1, row] = max(extents[1, row], u)


@compiled
def _turning(
    placement: Array, grid: Array32, layout: tuple[int, int], camera: Array, seen: Array, turning: Integers
) -> float:
    """Marks the cells of a grid whose corners do not all face the camera, nor all turn away from it.

    Only their sides can be outermost: a line all around which the surface faces the camera lies inside.

    Args:
        placement: (4, 4) world_from_part, metres.
        grid: (R * C, 7) points, normals and their product, ring by ring; C at most 62.
        layout: R, C.
        camera: (29,) row of `Rig.packed`.
        seen: (2, R * C) workspace.
        turning: (R + 1,) output: bit c of number r + 1 is the cell between rings r and r + 1, columns c and c + 1; the
            first number and the last one are 0.

    Returns:
        Least depth of the points, metres.
    """
    n_rows, n_columns = layout
    x, y, z = (
        camera[at.CENTRE_X] - placement[0, 3],
        camera[at.CENTRE_Y] - placement[1, 3],
        camera[at.CENTRE_Z] - placement[2, 3],
    )
    ex = placement[0, 0] * x + placement[1, 0] * y + placement[2, 0] * z
    ey = placement[0, 1] * x + placement[1, 1] * y + placement[2, 1] * z
    ez = placement[0, 2] * x + placement[1, 2] * y + placement[2, 2] * z
    a, b, c = camera[at.R31], camera[at.R32], camera[at.R33]
    dx = a * placement[0, 0] + b * placement[1, 0] + c * placement[2, 0]
    dy = a * placement[0, 1] + b * placement[1, 1] + c * placement[2, 1]
    dz = a * placement[0, 2] + b * placement[1, 2] + c * placement[2, 2]
    away = -(a * x + b * y + c * z)
    for i in range(n_rows * n_columns):
        seen[0, i] = grid[i, 3] * ex + grid[i, 4] * ey + grid[i, 5] * ez - grid[i, 6]
        seen[1, i] = grid[i, 0] * dx + grid[i, 1] * dy + grid[i, 2] * dz + away
    nearest = np.inf
    for i in range(n_rows * n_columns):
        nearest = min(nearest, seen[1, i])
    turning[0] = turning[n_rows] = 0
    before = before_along = 0
    for r in range(n_rows):
        row = 0
        for k in range(n_columns):
            row |= int(seen[0, r * n_columns + k] > 0.0) << k
        along = row ^ ((row >> 1) | ((row & 1) << (n_columns - 1)))
        if r > 0:
            turning[r] = along | before_along | (row ^ before)
        before, before_along = row, along
    return nearest


@compiled
def _or_before(bits: int, n: int) -> int:
    """Bits of a ring of n, each set where it or the one before it was."""
    return (bits | (bits << 1) | (bits >> (n - 1))) & ((1 << n) - 1)


@compiled
def _widen_turning(
    placement: Array,
    grid: Array32,
    layout: tuple[int, int],
    camera: Array,
    turning: Integers,
    pixels: Array,
    extents: Array,
) -> bool:
    """Widens extents (2, h) by the sides of the cells that `_turning` marked; `pixels` (2, R * C) is workspace.

    Returns:
        False where one of them lies beyond the reach of the lens: nothing is widened then.
    """
    n_rows, n_columns = layout
    for r in range(n_rows):
        left = _or_before(turning[r] | turning[r + 1], n_columns)
        while left:
            i = r * n_columns + lowest_bit(left)
            left &= left - 1
            x, y, z = grid[i, 0], grid[i, 1], grid[i, 2]
            wx = placement[0, 0] * x + placement[0, 1] * y + placement[0, 2] * z + placement[0, 3]
            wy = placement[1, 0] * x + placement[1, 1] * y + placement[1, 2] * z + placement[1, 3]
            wz = placement[2, 0] * x + placement[2, 1] * y + placement[2, 2] * z + placement[2, 3]
            pixels[0, i], pixels[1, i], depth = project_point(camera, wx, wy, wz)
            if depth <= 0.0:
                return False
    for r in range(n_rows):
        left = turning[r] | turning[r + 1]
        while left:
            c = lowest_bit(left)
            left &= left - 1
            i, beside = r * n_columns + c, r * n_columns + (c + 1 if c + 1 < n_columns else 0)
            widen(pixels[0, i], pixels[1, i], pixels[0, beside], pixels[1, beside], extents)
        left = _or_before(turning[r + 1], n_columns)
        while left:
            i = r * n_columns + lowest_bit(left)
            left &= left - 1
            below = i + n_columns
            widen(pixels[0, i], pixels[1, i], pixels[0, below], pixels[1, below], extents)
    return True


@compiled
def fill_parts(placements: Array, grids: Array32, layout: tuple[int, int], camera: Array, mask: Mask) -> None:
    """Sets the pixels whose centres the parts cover: row by row, between the outermost lines of their grids.

    Lines that lie inside are not even projected: 4 of 5 at 25 x 48 points, a quarter of the time with all of them.

    Args:
        placements: (P, 4, 4) world_from_part, metres.
        grids: (P, F, 7) surface points first; see `tracker.kernels.contours.pieces.find_pieces`.
        layout: R, C of the grids, with F = (2 R - 1) (2 C) and 2 C at most 62.
        camera: (29,) row of `Rig.packed`.
        mask: (h, w) in and out; parts that come nearer to the camera than 5 cm, or that are not wholly within the reach
            of its lens, are left out, as in all other pictures.
    """
    height, width = mask.shape
    nodes = 2 * layout[0] - 1, 2 * layout[1]
    n = nodes[0] * nodes[1]
    pixels, seen, extents = np.zeros((2, n)), np.zeros((2, n)), np.zeros((2, height))
    turning = np.zeros(nodes[0] + 1, dtype=np.int64)
    for p in range(len(placements)):
        if _turning(placements[p], grids[p], nodes, camera, seen, turning) < NEAREST_M:
            continue
        extents[0], extents[1] = np.inf, -np.inf
        if not _widen_turning(placements[p], grids[p], nodes, camera, turning, pixels, extents):
            continue
        for row in range(height):
            if extents[0, row] <= extents[1, row]:
                first = max(int(np.ceil(extents[0, row])), 0)
                last = min(int(np.floor(extents[1, row])), width - 1)
                for column in range(first, last + 1):
                    mask[row, column] = True
