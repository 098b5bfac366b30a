"""What of weighted pictures a body covers, for many poses: the silhouettes are filled small and never kept.

Parts that stand still in a batch are filled once for all poses, and not even once if they stand as in the batch before;
where those are that stand as in the pose before is not found anew.
"""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Array32, Integers, Mask, Numbers16
from tracker.kernels.compilation import compiled
from tracker.kernels.contours.scoring import repeated_parts
from tracker.kernels.pictures.silhouettes import NEAREST_M, widen
from tracker.kernels.projection import project_grid


@compiled
def _extents(
    placement: Array, grid: Array32, layout: tuple[int, int], camera: Array, pixels: Array, extents: Array
) -> tuple[int, int]:
    """Writes where a part's rows of pixels begin and end (2, h); its first row and the one after its last."""
    n_rows, n_columns = layout
    if project_grid(placement, grid, camera, pixels) <= NEAREST_M:
        return 0, 0
    low, high = np.inf, -np.inf
    for i in range(n_rows * n_columns):
        low, high = min(low, pixels[1, i]), max(high, pixels[1, i])
    height = extents.shape[1]
    first, last = max(int(np.ceil(low)), 0), min(int(np.floor(high)), height - 1)
    for row in range(first, last + 1):
        extents[0, row], extents[1, row] = np.inf, -np.inf
    for r in range(n_rows):
        for c in range(n_columns):
            i, beside = r * n_columns + c, r * n_columns + (c + 1) % n_columns
            widen(pixels[0, i], pixels[1, i], pixels[0, beside], pixels[1, beside], extents)
            if r + 1 < n_rows:
                below = i + n_columns
                widen(pixels[0, i], pixels[1, i], pixels[0, below], pixels[1, below], extents)
    return first, last + 1


@compiled
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
    covered, sums = np.zeros(len(pictures), dtype=np.bool_), np.zeros((len(regions), 2))
    pixels = np.zeros((3, layout[0] * layout[1]))
    for v in range(len(regions)):
        start, width, height = regions[v]
        if width == 0:
            continue
        extents = np.zeros((2, height))
        for p in range(len(still)):
            if not still[p]:
                continue
            first, end = _extents(placements[0, p], grids[p], layout, cameras[v], pixels, extents)
            for row in range(first, end):
                left = max(int(np.ceil(extents[0, row])), 0)
                for column in range(left, min(int(np.floor(extents[1, row])), width - 1) + 1):
                    at = start + row * width + column
                    if not covered[at]:
                        covered[at] = True
                        sums[v, 0] += pictures[at, 0]
                        sums[v, 1] += pictures[at, 1]
    return covered, sums


@compiled
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
    covered, base = still
    n_poses, n_parts = placements.shape[:2]
    sums, same = np.zeros((n_poses, len(regions), 2)), repeated_parts(placements)
    pixels, rows = np.zeros((3, layout[0] * layout[1])), np.zeros((n_parts, 2), dtype=np.int64)
    last = np.full(len(pictures), -1, dtype=np.int64)
    for v in range(len(regions)):
        start, width, height = regions[v]
        if width == 0:
            continue
        extents = np.zeros((n_parts, 2, height))
        for b in range(n_poses):
            sums[b, v, 0], sums[b, v, 1] = base[v, 0], base[v, 1]
            for p in range(n_parts):
                if not moving[p]:
                    continue
                if not same[b, p]:
                    placed = placements[b, p], grids[p], layout, cameras[v]
                    rows[p, 0], rows[p, 1] = _extents(*placed, pixels, extents[p])
                for row in range(rows[p, 0], rows[p, 1]):
                    left = max(int(np.ceil(extents[p, 0, row])), 0)
                    for column in range(left, min(int(np.floor(extents[p, 1, row])), width - 1) + 1):
                        at = start + row * width + column
                        if covered[at] or last[at] == b:
                            continue
                        last[at] = b
                        sums[b, v, 0] += pictures[at, 0]
                        sums[b, v, 1] += pictures[at, 1]
    return sums


@compiled
def cover_shares(mask: Mask, factor: int, shares: Array32) -> None:
    """Share (h, w) of each square of `factor` pixels along its side that a mask (H, W) covers."""
    height, width = shares.shape
    counts = np.empty(mask.shape[1], dtype=np.uint16)
    share = np.float32(1.0 / (factor * factor))
    for row in range(height):
        counts[:] = 0
        for y in range(row * factor, (row + 1) * factor):
            _count(mask[y], counts)
        for column in range(width):
            covered = 0
            for x in range(column * factor, (column + 1) * factor):
                covered += counts[x]
            shares[row, column] = np.float32(covered) * share


@compiled
def _count(row: Mask, counts: Numbers16) -> None:
    # A function, for operators widen whole numbers to 64 bits.
    for x in range(len(counts)):
        counts[x] = np.add(counts[x], np.uint16(row[x]))
