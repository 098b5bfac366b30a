"""Poses synthesized and compared with an observation in one go: no contour is written to memory.

In a decomposed search most parts of the body stand still. They are traced once for all its poses; of each only the
moving parts are traced, and tested for what they hide of the others. Parts that stand as in the pose before are not
even drawn again: side by side with other searches of the same limb half of the moving ones do.
"""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Array32, Integers, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.contours.chamfer import directed_pair, matching_workspace
from tracker.kernels.contours.occlusion import cover
from tracker.kernels.contours.solids import place_solid, place_solids, view_solid, view_solids
from tracker.kernels.contours.tracing import Tracing, add_visible, draw_part, trace_view, tracing_workspace
from tracker.kernels.rows import region, sample, solid, spot
from tracker.kernels.rows.workspace import ROW

_MOST_KEPT = 96
"""Samples of a part that are kept for the next pose; parts of more are drawn again."""


@compiled
def moving_parts(placements: Array) -> Mask:
    """Parts (P,) whose placements (B, P, 4, 4) are not the same in all poses; all of them where B is 0 or 1."""
    n_poses, n_parts = placements.shape[:2]
    moving = np.zeros(n_parts, dtype=np.bool_)
    for p in range(n_parts):
        moving[p] = n_poses <= 1
        for b in range(1, n_poses):
            for r in range(3):
                for k in range(4):
                    moving[p] |= placements[b, p, r, k] != placements[0, p, r, k]
    return moving


@compiled
def repeated_parts(placements: Array) -> Mask:
    """Parts (B, P) that stand as in the pose before, of placements (B, P, 4, 4)."""
    n_poses, n_parts = placements.shape[:2]
    same = np.zeros((n_poses, n_parts), dtype=np.bool_)
    for b in range(1, n_poses):
        for p in range(n_parts):
            same[b, p] = True
            for r in range(3):
                for k in range(4):
                    same[b, p] &= placements[b, p, r, k] == placements[b - 1, p, r, k]
    return same


@compiled
def _add_moving(
    grids: Array32,
    planes: Array32,
    layout: tuple[int, int],
    bounds: Array,
    solids: Array32,
    camera: Array32,
    size: tuple[float, float],
    spacing: tuple[float, float],
    masks: tuple[Mask, Mask],
    work: Tracing,
    traced: Array32,
    repeats: tuple[Mask, int],
    kept: tuple[Array32, Integers],
) -> int:
    """As `trace_view`, but parts that stand as in the pose before are taken from what was kept of it.

    Args:
        grids, planes, layout, bounds, solids, camera, size, spacing, masks, work, traced: see `trace_view`.
        repeats: from `repeated_parts`; the pose.
        kept: samples (P, 11 `_MOST_KEPT`) of the pose before; their numbers (P,), -1 for parts of too many.
    """
    wanted, covering = masks
    same, b = repeats
    samples, counts = kept
    spots = work[6]
    n = 0
    for p in range(len(solids)):
        if solids[p, solid.NEAREST] < 0.0 or not wanted[p]:
            continue
        if same[b, p] and counts[p] >= 0:
            n_spots = counts[p]
            for k in range(spot.STATE // ROW):
                for i in range(n_spots):
                    spots[k * ROW + i] = samples[p, k * _MOST_KEPT + i]
            for i in range(n_spots):
                spots[spot.STATE + i] = 0.0
        else:
            n_spots = draw_part(grids, planes, layout, p, solids, camera, size, spacing[0], work)
            counts[p] = n_spots if n_spots <= _MOST_KEPT else -1
            if counts[p] >= 0 and b + 1 < len(same) and same[b + 1, p]:
                for k in range(spot.STATE // ROW):
                    for i in range(n_spots):
                        samples[p, k * _MOST_KEPT + i] = spots[k * ROW + i]
        n = add_visible(p, solids, covering, bounds[0, p], spacing[1], work, n_spots, traced, n)
    return n


@compiled
def _lay_out(still: Array32, n_still: int, spots: Array32) -> None:
    """Writes the samples of parts that stand still as `cover` wants them, but for their state."""
    for i in range(n_still):
        for k in range(sample.PART):
            spots[k * ROW + i] = still[i, k]
        for k in range(3):
            spots[spot.NX + k * ROW + i] = still[i, sample.NX + k]


@compiled
def _add_seen(
    still: Array32,
    n_still: int,
    solids: Array32,
    moving: Mask,
    contact_m: float,
    spots: Array32,
    traced: Array32,
    n: int,
) -> int:
    """Appends to n traced samples those of the parts that stand still that no moving one covers; their number."""
    for i in range(n_still):
        spots[spot.STATE + i] = still[i, sample.BETWEEN]
    for q in range(len(solids)):
        if moving[q] and solids[q, solid.NEAREST] > 0.0:
            cover(solids, q, contact_m, spots, n_still)
    for i in range(n_still):
        if spots[spot.STATE + i] == 0.0 and n < len(traced):
            for k in range(sample.LENGTH + 1):
                traced[n, k] = still[i, k]
            n += 1
    return n


@compiled
def trace_still(
    placements: Array,
    still: Mask,
    shapes: Array,
    grids: Array32,
    planes: Array32,
    layout: tuple[int, int],
    bounds: Array,
    cameras: Array,
    sizes: Array,
    spacing: tuple[float, float],
) -> tuple[Array32, Integers]:
    """Contour samples of the parts that stand still in a search, for `score_poses`; nothing else covers them here.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres; the first one counts.
        still: (P,) the parts.
        shapes, grids, planes, layout, bounds, cameras, sizes, spacing: see `trace_contours`.

    Returns:
        (V, ROW, 13) samples, see `trace_view`; (V,) their numbers.
    """
    samples = np.zeros((len(cameras), ROW, sample.N_COLUMNS), dtype=np.float32)
    counts = np.zeros(len(cameras), dtype=np.int64)
    if not still.any():
        return samples, counts
    solids = np.zeros((len(shapes), solid.N_COLUMNS), dtype=np.float32)
    work, masks = tracing_workspace(len(shapes), layout), (still, still)
    place_solids(placements, 0, shapes, bounds, solids)
    for v in range(len(cameras)):
        view_solids(shapes, bounds, cameras[v], spacing[1], solids)
        camera, size = cameras[v].astype(np.float32), (sizes[v, 0], sizes[v, 1])
        counts[v] = trace_view(grids, planes, layout, bounds, solids, camera, size, spacing, masks, work, samples[v])
    return samples, counts


@compiled
def score_poses(
    placements: Array,
    shapes: Array,
    grids: Array32,
    planes: Array32,
    layout: tuple[int, int],
    bounds: Array,
    cameras: Array,
    sizes: Array,
    spacing: tuple[float, float],
    flat: Array32,
    regions: Integers,
    scene: Array32,
    first: Integers,
    rule: tuple[float, bool],
    moving: Mask,
    standing: tuple[Array32, Integers],
) -> Array:
    """Directed chamfer distances of many poses; the twin is `trace_contours` and `directed_distances`.

    Args:
        placements, shapes, grids, planes, layout, bounds, cameras, sizes, spacing: see `trace_contours`.
        flat, regions, scene, first: the observation, from `Observation.packed`.
        rule: distance at which a point is an outlier, px; reject outliers as the paper does, or else clamp them.
        moving: (P,) parts that do not stand still, at least those of `moving_parts`.
        standing: of the other parts, from `trace_still`.

    Returns:
        (B, V, 2) px: model to scene, scene to model; NaN for a missing view.
    """
    n_poses, n_views, n_parts = len(placements), len(cameras), len(shapes)
    result = np.full((n_poses, n_views, 2), np.nan)
    everything = np.ones(n_parts, dtype=np.bool_)
    solids = np.zeros((n_parts, solid.N_COLUMNS), dtype=np.float32)
    # room for all that there can be: memory that nothing is written to costs nothing
    traced = np.empty((ROW * n_parts, sample.N_COLUMNS), dtype=np.float32)
    spots = np.zeros(spot.N_ROWS * ROW, dtype=np.float32)
    tracing, matching = tracing_workspace(n_parts, layout), matching_workspace(len(scene), len(traced))
    same = repeated_parts(placements)
    kept = np.empty((n_parts, spot.STATE // ROW * _MOST_KEPT), dtype=np.float32), np.empty(n_parts, dtype=np.int64)
    for v in range(n_views):
        if regions[v, region.WIDTH] == 0:
            continue
        camera, size, part = cameras[v].astype(np.float32), (sizes[v, 0], sizes[v, 1]), (first[v], first[v + 1])
        still, n_still = standing[0][v], standing[1][v]
        _lay_out(still, n_still, spots)
        # As many samples as there is room for may be too few: then all parts are traced for every pose.
        masks = (moving, everything) if n_still < ROW else (everything, everything)
        lens = cameras[v]
        for b in range(n_poses):
            for p in range(n_parts):
                if not same[b, p]:
                    place_solid(placements, b, p, shapes, bounds, solids)
                    view_solid(shapes, bounds, lens, spacing[1], p, solids)
            n = _add_moving(
                grids,
                planes,
                layout,
                bounds,
                solids,
                camera,
                size,
                spacing,
                masks,
                tracing,
                traced,
                (same, b),
                kept,
            )
            if 0 < n_still < ROW:
                n = _add_seen(still, n_still, solids, moving, spacing[1], spots, traced, n)
            result[b, v] = directed_pair(traced, n, flat, regions, v, scene, part, rule, matching)
    return result
