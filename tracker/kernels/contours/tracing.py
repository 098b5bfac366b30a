"""Visible occluding-contour samples of tapered superquadrics, without rendering a picture.

The pieces of contour of each part are found on its surface grid (`contour_pieces`), cut into samples of equal
length, bent by the turn of their normals, and tested for visibility (`occlusion`). The cost does not depend on the
image size.

Arrays are indexed here, never sliced, in the inner loops: a slice costs a reference count.
"""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Array32, Integers, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.contours.occlusion import (
    ROW,
    SOLID_COLUMNS,
    SPOT_ROWS,
    cover,
    neighbours,
    place_solids,
    view_solids,
)
from tracker.kernels.contours.pieces import CROSSING_ROWS, find_pieces
from tracker.kernels.projection import project_point

Tracing = tuple[Array32, Integers, Integers, Integers, Array32, Integers, Array32]
"""Facings, crossing numbers, neighbours, links, crossings, pieces and samples of one part."""


@compiled(fastmath={"contract", "nsz", "arcp"})
def _sample(
    crossings: Array32, pieces: Integers, n_pieces: int, size: tuple[float, float], step_px: float, spots: Array32
) -> int:
    """Cuts the contour of one part into samples of equal length, those inside the image; their number.

    A sample between two crossings is bent by the turn of their normals, in space and in the image.
    """
    one, half = np.float32(1.0), np.float32(0.5)
    low, wide, high = np.float32(-0.5), np.float32(size[0] - 0.5), np.float32(size[1] - 0.5)
    total = np.float32(0.0)
    for k in range(n_pieces):
        total += crossings[24 * ROW + k]
    each = np.float32(total / min(np.ceil(total / step_px), ROW - 1.0)) if total > 0.0 else one
    passed, place, n = np.float32(0.0), half * each, 0
    for k in range(n_pieces):
        length = crossings[24 * ROW + k]
        if place >= passed + length:
            passed += length
            continue
        i, j = pieces[k, 0], pieces[k, 1]
        x0, y0, z0 = crossings[14 * ROW + i], crossings[15 * ROW + i], crossings[16 * ROW + i]
        a0, b0, c0 = crossings[17 * ROW + i], crossings[18 * ROW + i], crossings[19 * ROW + i]
        u0, v0, nu0, nv0 = (
            crossings[20 * ROW + i],
            crossings[21 * ROW + i],
            crossings[22 * ROW + i],
            crossings[23 * ROW + i],
        )
        dx, dy, dz = crossings[14 * ROW + j] - x0, crossings[15 * ROW + j] - y0, crossings[16 * ROW + j] - z0
        da, db, dc = crossings[17 * ROW + j] - a0, crossings[18 * ROW + j] - b0, crossings[19 * ROW + j] - c0
        du, dv = crossings[20 * ROW + j] - u0, crossings[21 * ROW + j] - v0
        dnu, dnv = crossings[22 * ROW + j] - nu0, crossings[23 * ROW + j] - nv0
        turn, turn_px = da * dx + db * dy + dc * dz, dnu * du + dnv * dv
        while place < passed + length and n < ROW:
            t = (place - passed) / length
            place += each
            bulge = half * t * (one - t)
            nu, nv = nu0 + t * dnu, nv0 + t * dnv
            norm = one / np.sqrt(nu * nu + nv * nv)
            nu, nv = nu * norm, nv * norm
            u, v = u0 + t * du + bulge * turn_px * norm * nu, v0 + t * dv + bulge * turn_px * norm * nv
            if u < low or v < low or u > wide or v > high:
                continue
            a, b, c = a0 + t * da, b0 + t * db, c0 + t * dc
            height = bulge * turn
            spots[n], spots[ROW + n], spots[2 * ROW + n], spots[3 * ROW + n] = u, v, nu, nv
            spots[4 * ROW + n], spots[11 * ROW + n] = each, 0.0
            spots[5 * ROW + n], spots[6 * ROW + n] = x0 + t * dx + height * a, y0 + t * dy + height * b
            spots[7 * ROW + n] = z0 + t * dz + height * c
            spots[8 * ROW + n], spots[9 * ROW + n], spots[10 * ROW + n] = a, b, c
            n += 1
        passed += length
    return n


@compiled
def trace_view(
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
) -> int:
    """Visible contour samples of all parts in one view.

    Args:
        grids, planes, layout: surface grids, see `find_pieces`.
        bounds: (3, P), see `place_solids`.
        solids: (P, 48) parts in the view.
        camera: (25,) row of `Rig.packed`, single precision.
        size: width and height of the image, px.
        spacing: longest contour a sample stands for, px; distance at which parts touch, metres.
        masks: (P,) parts that are traced; parts that may cover them.
        work: workspace from `tracing_workspace`.
        traced: (M, 13) output: pixel, image normal, contour length (0 between parts), world point, part, 1 between
            parts else 0, world normal; further samples are dropped.

    Returns:
        Number of samples.
    """
    facing, ids, listed, links, crossings, pieces, spots = work
    wanted, covering = masks
    n = 0
    for p in range(len(solids)):
        if solids[p, 28] < 0.0 or not wanted[p]:
            continue
        n_pieces = find_pieces(grids, planes, layout, p, solids, camera, facing, ids, links, crossings, pieces)
        n_spots = _sample(crossings, pieces, n_pieces, size, spacing[0], spots)
        for k in range(neighbours(p, solids, covering, bounds[0, p], listed)):
            cover(solids, listed[k], spacing[1], spots, n_spots)
        for i in range(n_spots):
            state = spots[11 * ROW + i]
            if state == 2.0 or n == len(traced):
                continue
            for k in range(8):
                traced[n, k] = spots[k * ROW + i]
            if state == 1.0:
                traced[n, 4] = 0.0
            traced[n, 8], traced[n, 9] = p, state
            for k in range(3):
                traced[n, 10 + k] = spots[(8 + k) * ROW + i]
            n += 1
    return n


@compiled
def tracing_workspace(n_parts: int, layout: tuple[int, int]) -> Tracing:
    """What `trace_view` writes to on its way."""
    return (
        np.zeros(layout[0] * layout[1], dtype=np.float32),
        np.zeros((3, layout[1]), dtype=np.int64),
        np.zeros(n_parts, dtype=np.int64),
        np.zeros((ROW, 2), dtype=np.int64),
        np.zeros(CROSSING_ROWS * ROW, dtype=np.float32),
        np.zeros((ROW, 2), dtype=np.int64),
        np.zeros(SPOT_ROWS * ROW, dtype=np.float32),
    )


@compiled
def trace_contours(
    placements: Array,
    shapes: Array,
    grids: Array32,
    planes: Array32,
    layout: tuple[int, int],
    bounds: Array,
    cameras: Array,
    sizes: Array,
    spacing: tuple[float, float],
    exact: bool,
    positions: Array32,
    points: Array32,
    parts: Integers,
    between: Mask,
    counts: Integers,
) -> None:
    """Visible occluding-contour samples of many poses in all views.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres.
        shapes: (P, 7) packed superquadrics.
        grids, planes, layout: surface grids, see `find_pieces`.
        bounds: (3, P), see `place_solids`.
        cameras: (V, 25) from `Rig.packed`.
        sizes: (V, 2) image sizes, px.
        spacing: contour a sample stands for, px; distance at which parts touch, metres.
        exact: place pixels where the points are seen, or else where they are traced, as `score_poses` does: bent in
            the image and in space, a sample's pixel and point are up to 0.05 px apart.
        positions: (B, V, M, 5) output: pixel, image normal, contour length.
        points: (B, V, M, 3) output: world positions.
        parts, between, counts: outputs, laid out as in `Contours`.
    """
    solids = np.zeros((len(shapes), SOLID_COLUMNS), dtype=np.float32)
    work = tracing_workspace(len(shapes), layout)
    traced = np.zeros((parts.shape[2], 13), dtype=np.float32)
    lenses = cameras.astype(np.float32)
    everything = np.ones(len(shapes), dtype=np.bool_)
    masks = everything, everything
    for b in range(len(placements)):
        place_solids(placements, b, shapes, bounds, solids)
        for v in range(len(cameras)):
            view_solids(shapes, bounds, cameras[v], spacing[1], solids)
            size = sizes[v, 0], sizes[v, 1]
            n_traced = trace_view(grids, planes, layout, bounds, solids, lenses[v], size, spacing, masks, work, traced)
            n = 0
            for i in range(n_traced):
                x, y = float(traced[i, 0]), float(traced[i, 1])
                if exact:
                    x, y, _ = project_point(cameras[v], traced[i, 5], traced[i, 6], traced[i, 7])
                if x < -0.5 or y < -0.5 or x > size[0] - 0.5 or y > size[1] - 0.5:
                    continue
                positions[b, v, n, 0], positions[b, v, n, 1] = x, y
                for k in range(3):
                    positions[b, v, n, 2 + k] = traced[i, 2 + k]
                    points[b, v, n, k] = traced[i, 5 + k]
                parts[b, v, n] = int(traced[i, 8])
                between[b, v, n] = traced[i, 9] > 0.0
                n += 1
            counts[b, v] = n
