"""The region of an image that convex parts cover."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Mask


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
    native.fill_parts(placements, grids, layout, camera, mask)
