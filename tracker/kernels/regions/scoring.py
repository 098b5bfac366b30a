"""Poses synthesized and compared with the colours of the images in one go: no contour is written to memory.

In a decomposed search most parts of the body stand still. They are traced, and their lines read, once for all poses;
of each pose only the moving parts are, and it is asked which lines of the others they cover or lie beside.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tracker.arrays import Array, Array32, Integers, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.contours.occlusion import cover
from tracker.kernels.contours.scoring import moving_parts
from tracker.kernels.contours.solids import place_solids, view_solids
from tracker.kernels.contours.tracing import trace_view, tracing_workspace
from tracker.kernels.regions.colours import Picture
from tracker.kernels.regions.lines import BACKGROUND, Lines, Looks, Rule
from tracker.kernels.regions.misfits import add_misfit, judged
from tracker.kernels.regions.sides import nearest_beside, parts_near, place_spots
from tracker.kernels.rows import region, sample, solid, spot
from tracker.kernels.rows.camera import FX
from tracker.kernels.rows.workspace import ROW


class _Kept(NamedTuple):
    """The lines of the parts that stand still, at most `ROW`, as long as nothing that moves is near."""

    samples: Array32
    """(ROW, 13) from `trace_view`."""

    spots: Array
    """(ROW, 1, 5) from `place_spots`."""

    sides: Integers
    """(ROW,) part seen at the spot."""

    depths: Array
    """(ROW,) where a ray passes its middle, see `nearest_beside`."""

    wrong: Array
    """(ROW, 2) share of the line on the wrong side, and how long a line is, px."""


@compiled
def _row(v: int, samples: Array32, i: int) -> tuple[int, int, float, float, float, float]:
    """View, part, pixel and normal of a traced sample."""
    u, w = float(samples[i, sample.U]), float(samples[i, sample.V])
    return v, int(samples[i, sample.PART]), u, w, float(samples[i, sample.NU]), float(samples[i, sample.NV])


@compiled
def _point(samples: Array32, i: int) -> tuple[float, float, float]:
    """World point of a traced sample."""
    return float(samples[i, sample.X]), float(samples[i, sample.Y]), float(samples[i, sample.Z])


@compiled
def _read_still(
    picture: Picture,
    looks: Looks,
    rule: Rule,
    cameras: Array,
    v: int,
    kept: _Kept,
    n_still: int,
    solids: Array32,
    still: Mask,
) -> None:
    """Reads the lines of the parts that stand still, among themselves."""
    near, last, n = np.zeros(len(solids), dtype=np.int64), BACKGROUND, 0
    for i in range(n_still):
        if kept.samples[i, sample.LENGTH] <= 0.0:
            continue
        place, point = _row(v, kept.samples, i), _point(kept.samples, i)
        place_spots(cameras, v, point, (place[4], place[5]), rule.step_m, kept.spots, i)
        if place[1] != last:
            last = place[1]
            n = parts_near(solids, still, last, cameras[v, FX], rule.step_m, near)
        side, depth = nearest_beside(solids, near, n, kept.spots, (i, 0), (BACKGROUND, np.inf))
        kept.sides[i], kept.depths[i] = side, depth
        kept.wrong[i, 0], kept.wrong[i, 1] = judged(picture, looks, rule, cameras, place, point, side)


@compiled
def _add_still(
    picture: Picture,
    looks: Looks,
    rule: Rule,
    cameras: Array,
    v: int,
    kept: _Kept,
    n_still: int,
    solids: Array32,
    moving: Mask,
    contact_m: float,
    spots: Array32,
    misfits: Array,
) -> None:
    """Adds the lines of the parts that stand still; those that something that moves lies beside are read anew."""
    for i in range(n_still):
        for k in range(sample.PART):
            spots[k * ROW + i] = kept.samples[i, k]
        for k in range(3):
            spots[spot.NX + k * ROW + i] = kept.samples[i, sample.NX + k]
        spots[spot.STATE + i] = kept.samples[i, sample.BETWEEN]
    for q in range(len(solids)):
        if moving[q] and solids[q, solid.NEAREST] > 0.0:
            cover(solids, q, contact_m, spots, n_still)
    near, last, n = np.zeros(len(solids), dtype=np.int64), BACKGROUND, 0
    for i in range(n_still):
        if spots[spot.STATE + i] != 0.0 or kept.samples[i, sample.LENGTH] <= 0.0:
            continue
        p, wrong, line_px = int(kept.samples[i, sample.PART]), kept.wrong[i, 0], kept.wrong[i, 1]
        if p != last:
            last, n = p, parts_near(solids, moving, p, cameras[v, FX], rule.step_m, near)
        side, _ = nearest_beside(solids, near, n, kept.spots, (i, 0), (kept.sides[i], kept.depths[i]))
        if side != kept.sides[i]:
            place, point = _row(v, kept.samples, i), _point(kept.samples, i)
            wrong, line_px = judged(picture, looks, rule, cameras, place, point, side)
        add_misfit(float(kept.samples[i, sample.LENGTH]), wrong, line_px, p, misfits)


@compiled
def _add_traced(
    picture: Picture,
    looks: Looks,
    rule: Rule,
    cameras: Array,
    v: int,
    traced: Array32,
    n_traced: int,
    solids: Array32,
    spots: Array,
    misfits: Array,
) -> None:
    """Adds the lines of some traced samples."""
    everything, near = np.ones(len(solids), dtype=np.bool_), np.zeros(len(solids), dtype=np.int64)
    last, n = BACKGROUND, 0
    for i in range(n_traced):
        if traced[i, sample.LENGTH] <= 0.0:
            continue
        place, point = _row(v, traced, i), _point(traced, i)
        place_spots(cameras, v, point, (place[4], place[5]), rule.step_m, spots, 0)
        if place[1] != last:
            last = place[1]
            n = parts_near(solids, everything, last, cameras[v, FX], rule.step_m, near)
        side, _ = nearest_beside(solids, near, n, spots, (0, 0), (BACKGROUND, np.inf))
        wrong, line_px = judged(picture, looks, rule, cameras, place, point, side)
        add_misfit(float(traced[i, sample.LENGTH]), wrong, line_px, place[1], misfits)


@compiled
def score_regions(
    placements: Array,
    shapes: Array,
    grids: Array32,
    planes: Array32,
    layout: tuple[int, int],
    bounds: Array,
    cameras: Array,
    sizes: Array,
    spacing: tuple[float, float],
    lines: Lines,
) -> Array:
    """Misfits of many poses; the twin is `trace_contours`, `parts_beside` and `score_lines`.

    Args:
        placements, shapes, grids, planes, layout, bounds, cameras, sizes, spacing: see `trace_contours`.
        lines: what they are compared with.

    Returns:
        (B, V, P, 3) see `score_lines`.
    """
    # Taken out once: numba counts references to all arrays of a tuple whenever it is taken out of another.
    picture, looks, wanted, rule = lines
    n_poses, n_views, n_parts = len(placements), len(cameras), len(shapes)
    misfits = np.zeros((n_poses, n_views, n_parts, 3))
    everything, moving = np.ones(n_parts, dtype=np.bool_), moving_parts(placements)
    solids = np.zeros((n_parts, solid.N_COLUMNS), dtype=np.float32)
    traced, spots = (
        np.empty((ROW * n_parts, sample.N_COLUMNS), dtype=np.float32),
        np.zeros(spot.N_ROWS * ROW, dtype=np.float32),
    )
    work, kept, own = tracing_workspace(n_parts, layout), _nothing_kept(), np.zeros((1, 1, 5))
    for v in range(n_views if n_poses > 0 else 0):
        if picture.layout[v, region.WIDTH] == 0:
            continue
        camera, size = cameras[v].astype(np.float32), (sizes[v, 0], sizes[v, 1])
        counts = wanted & looks.known[v]
        n_still = 0
        if not moving.all():
            place_solids(placements, 0, shapes, bounds, solids)
            view_solids(shapes, bounds, cameras[v], spacing[1], solids)
            masks = counts & ~moving, ~moving
            n_still = trace_view(
                grids, planes, layout, bounds, solids, camera, size, spacing, masks, work, kept.samples
            )
            _read_still(picture, looks, rule, cameras, v, kept, n_still, solids, ~moving)
        # As many samples as there is room for may be too few: then all parts are traced for every pose.
        masks = (counts & moving, everything) if n_still < ROW else (counts, everything)
        for b in range(n_poses):
            place_solids(placements, b, shapes, bounds, solids)
            view_solids(shapes, bounds, cameras[v], spacing[1], solids)
            n = trace_view(grids, planes, layout, bounds, solids, camera, size, spacing, masks, work, traced)
            _add_traced(picture, looks, rule, cameras, v, traced, n, solids, own, misfits[b, v])
            if 0 < n_still < ROW:
                _add_still(
                    picture, looks, rule, cameras, v, kept, n_still, solids, moving, spacing[1], spots, misfits[b, v]
                )
    return misfits


@compiled
def _nothing_kept() -> _Kept:
    return _Kept(
        np.zeros((ROW, sample.N_COLUMNS), dtype=np.float32),
        np.zeros((ROW, 1, 5)),
        np.zeros(ROW, dtype=np.int64),
        np.zeros(ROW),
        np.zeros((ROW, 2)),
    )
