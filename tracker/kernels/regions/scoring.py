"""Poses compared with the colours of the images: how much of the lines across their contours is on the wrong side.

In a decomposed search most parts of the body stand still. They are traced, and their lines read, once for all poses;
of each pose only the moving parts are, and it is asked which lines of the others they cover or lie beside.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tracker.arrays import Array, Array32, Integers, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.contours.occlusion import cover, place_solids, view_solids
from tracker.kernels.contours.scoring import moving_parts
from tracker.kernels.contours.tracing import trace_view, tracing_workspace
from tracker.kernels.regions.colours import EVEN, HIDDEN, Picture, colour_at
from tracker.kernels.regions.lines import BACKGROUND, DEEPEST, Looks, Rule, inside_share, pixels_per_metre
from tracker.kernels.regions.sides import nearest_beside, parts_near, place_spots
from tracker.kernels.rows import region, sample, solid, spot
from tracker.kernels.rows.camera import FX
from tracker.kernels.rows.workspace import ROW

_EXPLAINED = 0.45
"""A line with less than this share on the wrong side explains its contour; half tells nothing. Of tracked poses 89 to
92 % of the contour is explained so, of arms anywhere else 26 % (three rendered recordings)."""

_COMPARED = 4
"""Places on either side, two steps apart, that a score looks at."""


class Lines(NamedTuple):
    """What contours are compared with."""

    picture: Picture
    """Colours seen."""

    looks: Looks
    """Colours known."""

    wanted: Mask
    """(P,) parts whose contours count."""

    rule: Rule


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
def _wrong_share(
    picture: Picture,
    looks: Looks,
    place: tuple[int, int, float, float, float, float],
    side: int,
    spacing: tuple[float, float, float],
) -> float:
    """How much of a line lies on the wrong side of the contour, 0 to 1; -1 where something hides the part.

    Args:
        picture, looks: colours seen and known.
        place: view, part, pixel and unit image normal of the contour sample.
        side: part seen at the first of the `SPOTS`: of all places but one it is the one that counts.
        spacing: distance of the places on the line, px; how far it may go into the part, px; `Rule.floor`.
    """
    v, p, x, y, nu, nv = place
    step, deep, floor = spacing
    inside = outside = 0.0
    n_inside = n_hidden = 0
    for k in range(_COMPARED):
        along = 1.5 + 2.0 * k
        if k == 0 or along * step < deep:
            colour = colour_at(picture, v, x - nu * along * step, y - nv * along * step)
            share = inside_share(looks, v, p, side, colour, floor)
            if share == HIDDEN:
                share = float(EVEN)
                n_hidden += 1
            inside += share
            n_inside += 1
        colour = colour_at(picture, v, x + nu * along * step, y + nv * along * step)
        share = inside_share(looks, v, p, side, colour, floor)
        outside += share if share < HIDDEN else float(EVEN)
    if 2 * n_hidden > n_inside:
        return -1.0
    return 0.5 * (1.0 - inside / (254.0 * n_inside) + outside / (254.0 * _COMPARED))


@compiled
def _judged(
    picture: Picture,
    looks: Looks,
    rule: Rule,
    cameras: Array,
    place: tuple[int, int, float, float, float, float],
    point: tuple[float, float, float],
    side: int,
) -> tuple[float, float]:
    """Share of the line of a contour sample at a world point that is on the wrong side or -1, and its length, px."""
    size = pixels_per_metre(cameras[place[0]], point[0], point[1], point[2])
    step = max(size * rule.step_m, 1.0)
    spacing = step, DEEPEST * size * looks.half_extents[place[1]], rule.floor
    return _wrong_share(picture, looks, place, side, spacing), 4.0 * _COMPARED * step


@compiled
def _add(length: float, wrong: float, line_px: float, p: int, misfits: Array) -> None:
    """Adds a sample of part p, unless it is hidden, and the contour it stands for, to misfits (P, 3) of a view."""
    if wrong < 0.0:
        return
    misfits[p, 0] += length
    misfits[p, 1] += length * wrong * line_px
    misfits[p, 2] += length if wrong < _EXPLAINED else 0.0


@compiled
def score_lines(
    lines: Lines,
    positions: Array32,
    points: Array32,
    parts: Integers,
    counts: Integers,
    beside: Integers,
    cameras: Array,
    misfits: Array,
) -> None:
    """How much beside the contours of many poses lies on the wrong side of them.

    Args:
        lines: what they are compared with.
        positions, points, parts, counts: of `Contours`, for B poses.
        beside: (B, V, M, 2) parts seen at the `SPOTS`.
        cameras: (V, 28) from `Rig.packed`.
        misfits: (B, V, P, 3) output: contour compared, px; times how much of the line lies on the wrong side, px;
            contour whose lines show the part inside and not outside, px.
    """
    picture, looks, wanted, rule = lines
    for b in range(len(counts)):
        for v in range(counts.shape[1]):
            if picture.layout[v, region.WIDTH] == 0:
                continue
            for m in range(counts[b, v]):
                p, length = parts[b, v, m], float(positions[b, v, m, sample.LENGTH])
                if length <= 0.0 or not wanted[p] or not looks.known[v, p]:
                    continue
                point = float(points[b, v, m, 0]), float(points[b, v, m, 1]), float(points[b, v, m, 2])
                x, y = float(positions[b, v, m, 0]), float(positions[b, v, m, 1])
                place = v, p, x, y, float(positions[b, v, m, 2]), float(positions[b, v, m, 3])
                wrong, line_px = _judged(picture, looks, rule, cameras, place, point, beside[b, v, m, 0])
                _add(length, wrong, line_px, p, misfits[b, v])


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
        kept.wrong[i, 0], kept.wrong[i, 1] = _judged(picture, looks, rule, cameras, place, point, side)


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
            wrong, line_px = _judged(picture, looks, rule, cameras, place, point, side)
        _add(float(kept.samples[i, sample.LENGTH]), wrong, line_px, p, misfits)


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
        wrong, line_px = _judged(picture, looks, rule, cameras, place, point, side)
        _add(float(traced[i, sample.LENGTH]), wrong, line_px, place[1], misfits)


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
        np.zeros((128 * n_parts, sample.N_COLUMNS), dtype=np.float32),
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
