"""What of weighted pictures a body covers, for many poses: the silhouettes are filled small and never kept.

Parts that stand still in a batch are filled once for all poses, and not even once if they stand as in the batch before;
where those are that stand as in the pose before is not found anew.
"""

from __future__ import annotations

import numpy as np

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Integers, Mask


def cover_still(
    placements: Array,
    still: Mask,
    grids: Array32,
    layout: tuple[int, int],
    cameras: Array,
    regions: Integers,
    pictures: Array32,
) -> tuple[Mask, Array]:
    """What the parts that stand still in a search cover, for `covered_sums`.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres; the first one counts.
        still: (P,) the parts.
        grids, layout, cameras, regions, pictures: see `covered_sums`.

    Returns:
        (N,) pixels covered, all views end to end; (V, 2) sums over them.
    """
    covered, sums = np.empty(len(pictures), dtype=np.bool_), np.empty((len(regions), 2))
    native.cover_still(placements, still, grids, layout, cameras, regions, pictures, covered, sums)
    return covered, sums


def covered_sums(
    placements: Array,
    moving: Mask,
    grids: Array32,
    layout: tuple[int, int],
    cameras: Array,
    regions: Integers,
    pictures: Array32,
    still: tuple[Mask, Array],
) -> Array:
    """Sums of two pictures over what a body covers; the twin is `fill_parts` and a sum.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres.
        moving: (P,) parts that do not stand still.
        grids: (P, R * C, 3) surface points of each part, ring by ring.
        layout: R, C of the grids.
        cameras: (V, 29) from `Rig.packed`, of the small pictures.
        regions: (V, 3) start in `pictures`, width, height; width 0 for a view that does not count.
        pictures: (N, 2) both pictures of all views end to end.
        still: of the other parts, from `cover_still`.

    Returns:
        (B, V, 2) sums; 0 for views that do not count.
    """
    sums = np.empty((len(placements), len(regions), 2))
    native.covered_sums(placements, moving, grids, layout, cameras, regions, pictures, *still, sums)
    return sums


def cover_shares(mask: Mask, factor: int, shares: Array32) -> None:
    """Share (h, w) of each square of `factor` pixels along its side that a mask (H, W) covers."""
    native.cover_shares(mask, factor, shares)
