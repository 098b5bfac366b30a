"""The region of an image that convex parts cover."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Array32, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.projection import project_grid


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
def fill_parts(placements: Array, grids: Array32, layout: tuple[int, int], camera: Array, mask: Mask) -> None:
    """Sets the pixels whose centres the parts cover: row by row, between the outermost lines of their grids.

    Args:
        placements: (P, 4, 4) world_from_part, metres.
        grids: (P, F, 7) surface points first; see `tracker.kernels.contours.pieces.find_pieces`.
        layout: R, C of the grids, with F = (2 R - 1) (2 C).
        camera: (25,) row of `Rig.packed`.
        mask: (h, w) in and out; parts that are not wholly before the camera are left out.
    """
    height, width = mask.shape
    n_rows, n_columns = 2 * layout[0] - 1, 2 * layout[1]
    pixels, extents = np.zeros((3, n_rows * n_columns)), np.zeros((2, height))
    for p in range(len(placements)):
        if project_grid(placements[p], grids[p], camera, pixels) <= 0.0:
            continue
        extents[0], extents[1] = np.inf, -np.inf
        for r in range(n_rows):
            for c in range(n_columns):
                i = r * n_columns + c
                beside = r * n_columns + (c + 1 if c + 1 < n_columns else 0)
                widen(pixels[0, i], pixels[1, i], pixels[0, beside], pixels[1, beside], extents)
                if r + 1 < n_rows:
                    below = i + n_columns
                    widen(pixels[0, i], pixels[1, i], pixels[0, below], pixels[1, below], extents)
        for row in range(height):
            if extents[0, row] <= extents[1, row]:
                first = max(int(np.ceil(extents[0, row])), 0)
                last = min(int(np.floor(extents[1, row])), width - 1)
                for column in range(first, last + 1):
                    mask[row, column] = True
