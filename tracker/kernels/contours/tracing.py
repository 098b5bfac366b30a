"""Visible occluding-contour samples of tapered superquadrics, without rendering a picture.

The pieces of contour of each part are found on its surface grid (`contour_pieces`), cut into samples of equal
length, bent by the turn of their normals, and tested for visibility (`occlusion`). The cost does not depend on the
image size.

Arrays are indexed here, never sliced, in the inner loops: a slice costs a reference count.
"""

from __future__ import annotations

import numpy as np

import tracker._native as native
from tracker.arrays import Array, Array32, Integers, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.contours.occlusion import cover, neighbours
from tracker.kernels.contours.pieces import find_pieces
from tracker.kernels.rows import crossing, sample, solid, spot
from tracker.kernels.rows.workspace import ROW

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
        total += crossings[crossing.LENGTH + k]
    each = np.float32(total / min(np.ceil(total / step_px), ROW - 1.0)) if total > 0.0 else one
    passed, place, n = np.float32(0.0), half * each, 0
    for k in range(n_pieces):
        length = crossings[crossing.LENGTH + k]
        if place >= passed + length:
            passed += length
            continue
        i, j = pieces[k, 0], pieces[k, 1]
        x0, y0, z0 = crossings[crossing.X + i], crossings[crossing.Y + i], crossings[crossing.Z + i]
        a0, b0, c0 = crossings[crossing.NX + i], crossings[crossing.NY + i], crossings[crossing.NZ + i]
        u0, v0 = crossings[crossing.U + i], crossings[crossing.V + i]
        nu0, nv0 = crossings[crossing.NU + i], crossings[crossing.NV + i]
        dx, dy, dz = crossings[crossing.X + j] - x0, crossings[crossing.Y + j] - y0, crossings[crossing.Z + j] - z0
        da, db, dc = crossings[crossing.NX + j] - a0, crossings[crossing.NY + j] - b0, crossings[crossing.NZ + j] - c0
        du, dv = crossings[crossing.U + j] - u0, crossings[crossing.V + j] - v0
        dnu, dnv = crossings[crossing.NU + j] - nu0, crossings[crossing.NV + j] - nv0
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
            spots[spot.U + n], spots[spot.V + n], spots[spot.NU + n], spots[spot.NV + n] = u, v, nu, nv
            spots[spot.LENGTH + n], spots[spot.STATE + n] = each, 0.0
            spots[spot.X + n], spots[spot.Y + n] = x0 + t * dx + height * a, y0 + t * dy + height * b
            spots[spot.Z + n] = z0 + t * dz + height * c
            spots[spot.NX + n], spots[spot.NY + n], spots[spot.NZ + n] = a, b, c
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
        camera: (29,) row of `Rig.packed`, single precision.
        size: width and height of the image, px.
        spacing: longest contour a sample stands for, px; distance at which parts touch, metres.
        masks: (P,) parts that are traced; parts that may cover them.
        work: workspace from `tracing_workspace`.
        traced: (M, 13) output: pixel, image normal, contour length (0 between parts), world point, part, 1 between
            parts else 0, world normal; further samples are dropped.

    Returns:
        Number of samples.
    """
    wanted, covering = masks
    n = 0
    for p in range(len(solids)):
        if solids[p, solid.NEAREST] >= 0.0 and wanted[p]:
            n_spots = draw_part(grids, planes, layout, p, solids, camera, size, spacing[0], work)
            n = add_visible(p, solids, covering, bounds[0, p], spacing[1], work, n_spots, traced, n)
    return n


@compiled
def draw_part(
    grids: Array32,
    planes: Array32,
    layout: tuple[int, int],
    p: int,
    solids: Array32,
    camera: Array32,
    size: tuple[float, float],
    step_px: float,
    work: Tracing,
) -> int:
    """Contour samples of part p, whatever hides them, written to the last of the workspace; their number."""
    facing, ids, _, links, crossings, pieces, spots = work
    n_pieces = find_pieces(grids, planes, layout, p, solids, camera, facing, ids, links, crossings, pieces)
    return _sample(crossings, pieces, n_pieces, size, step_px, spots)


@compiled
def add_visible(
    p: int,
    solids: Array32,
    covering: Mask,
    radius: float,
    contact_m: float,
    work: Tracing,
    n_spots: int,
    traced: Array32,
    n: int,
) -> int:
    """Appends to n traced samples those of part p, in a sphere of that radius, that nothing hides; their number."""
    _, _, listed, _, _, _, spots = work
    for k in range(neighbours(p, solids, covering, radius, listed)):
        cover(solids, listed[k], contact_m, spots, n_spots)
    for i in range(n_spots):
        state = spots[spot.STATE + i]
        if state == 2.0 or n == len(traced):
            continue
        for k in range(sample.PART):
            traced[n, k] = spots[k * ROW + i]
        if state == 1.0:
            traced[n, sample.LENGTH] = 0.0
        traced[n, sample.PART], traced[n, sample.BETWEEN] = p, state
        for k in range(3):
            traced[n, sample.NX + k] = spots[spot.NX + k * ROW + i]
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
        np.zeros(crossing.N_ROWS * ROW, dtype=np.float32),
        np.zeros((ROW, 2), dtype=np.int64),
        np.zeros(spot.N_ROWS * ROW, dtype=np.float32),
    )


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
) -> int:
    """Visible occluding-contour samples of many poses in all views.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres.
        shapes: (P, 7) packed superquadrics.
        grids, planes, layout: surface grids, see `find_pieces`.
        bounds: (3, P), see `place_solids`.
        cameras: (V, 29) from `Rig.packed`.
        sizes: (V, 2) image sizes, px.
        spacing: contour a sample stands for, px; distance at which parts touch, metres.
        exact: place pixels where the points are seen, or else where they are traced, as `score_poses` does: bent in
            the image and in space, a sample's pixel and point are up to 0.05 px apart.
        positions: (B, V, M, 5) output: pixel, image normal, contour length.
        points: (B, V, M, 3) output: world positions.
        parts, between, counts: outputs, laid out as in `Contours`.

    Returns:
        Most samples traced in a view; with M there may be more. Of these `exact` may place some outside of the image.
    """
    return native.trace_contours(
        placements,
        shapes,
        grids,
        planes,
        layout,
        bounds,
        cameras,
        sizes,
        spacing,
        exact,
        positions,
        points,
        parts,
        between,
        counts,
    )
