"""Which part of a scene is seen beside a contour: an arm before the trunk has the trunk for its background."""

from __future__ import annotations

from typing import Any

import numpy as np

from tracker.arrays import Array, Array32, Integers, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.contours.occlusion import beside, blocks_ray
from tracker.kernels.contours.solids import in_part, place_solids, view_solids
from tracker.kernels.projection import project_along
from tracker.kernels.regions.lines import BACKGROUND, SPOTS, pixels_per_metre
from tracker.kernels.rows import sample, solid
from tracker.kernels.rows.camera import CENTRE_X, CENTRE_Y, CENTRE_Z, FX

_FAR = 3.0
"""Rays are followed to this many times the distance of the contour: through all that may lie behind it."""

_ROUGH_PX = 2.0
"""How far a contour may be outside of the box around its part, px: lenses bend it."""

_single: Any = np.float32
"""As the other ray tests have it: in double precision they would be compiled once more."""


@compiled
def parts_near(solids: Array32, among: Mask, p: int, fx_px: float, step_m: float, near: Integers) -> int:
    """Lists those of some parts that may be seen at the `SPOTS` of part p; their number.

    Args:
        solids: (P, 48) parts in the view.
        among: (P,) parts asked about.
        p: the part whose contour it is.
        fx_px: focal length of the view.
        step_m: see `Rule`.
        near: (P,) output.
    """
    n = 0
    margin_px = SPOTS[1] * max(fx_px * step_m / solids[p, solid.NEAREST], 1.0) + _ROUGH_PX
    for q in range(len(solids)):
        if not among[q] or q == p or solids[q, solid.NEAREST] < 0.0:
            continue
        if (
            solids[q, solid.LEAST_U] - margin_px < solids[p, solid.MOST_U]
            and solids[q, solid.MOST_U] + margin_px > solids[p, solid.LEAST_U]
            and solids[q, solid.LEAST_V] - margin_px < solids[p, solid.MOST_V]
            and solids[q, solid.MOST_V] + margin_px > solids[p, solid.LEAST_V]
        ):
            near[n] = q
            n += 1
    return n


@compiled
def nearest_beside(
    solids: Array32, near: Integers, n: int, spots: Array, place: tuple[int, int], before: tuple[int, float]
) -> tuple[int, float]:
    """The part that a ray meets first: the one whose middle it passes first.

    Args:
        solids: (P, 48) parts in the view.
        near: parts asked about, see `parts_near`.
        n: their number.
        spots: (N, K, 5) from `place_spots`.
        place: which of them.
        before: what is known of the other parts: the first one, and where the ray passes its middle.

    Returns:
        The part, -1 for none; where the ray passes its middle, as a share of its length.
    """
    found, least = before
    i, k = place
    u, v = spots[i, k, 0], spots[i, k, 1]
    x, y, z = spots[i, k, 2], spots[i, k, 3], spots[i, k, 4]
    for m in range(n):
        q = near[m]
        if beside(solids, q, u, v) > solids[q, solid.WIDTH2]:
            continue
        a, b, c = in_part(solids, q, x, y, z)
        if not blocks_ray(solids, q, _single(a), _single(b), _single(c)):
            continue
        da, db, dc = a - solids[q, solid.EYE_X], b - solids[q, solid.EYE_Y], c - solids[q, solid.EYE_Z]
        along = -(solids[q, solid.EYE_X] * da + solids[q, solid.EYE_Y] * db + solids[q, solid.EYE_Z] * dc) / (
            da * da + db * db + dc * dc
        )
        if along < least:
            found, least = q, along
    return found, least


@compiled
def place_spots(
    cameras: Array,
    v: int,
    point: tuple[float, float, float],
    normal: tuple[float, float],
    step_m: float,
    spots: Array,
    i: int,
) -> None:
    """Writes where the `SPOTS` of a contour point are: pixels, and the far ends of the rays through them.

    A spot is reached in space: the point on the contour moved across its viewing ray until its image has moved.

    Args:
        cameras: (V, 29) from `Rig.packed`.
        v: the view.
        point: in the world, metres.
        normal: unit image normal.
        step_m: see `Rule`.
        spots: (N, K, 5) output, for the first K of them.
        i: the row to write.
    """
    x, y, z = point
    u, w, sx, sy, sz = project_along(cameras, v, point, normal)
    step = max(pixels_per_metre(cameras[v], x, y, z) * step_m, 1.0)
    cx, cy, cz = cameras[v, CENTRE_X], cameras[v, CENTRE_Y], cameras[v, CENTRE_Z]
    for k in range(spots.shape[1]):
        far = SPOTS[k] * step
        move = far / (sx * sx + sy * sy + sz * sz)
        spots[i, k, 0], spots[i, k, 1] = u + far * normal[0], w + far * normal[1]
        spots[i, k, 2] = cx + _FAR * (x + move * sx - cx)
        spots[i, k, 3] = cy + _FAR * (y + move * sy - cy)
        spots[i, k, 4] = cz + _FAR * (z + move * sz - cz)


@compiled
def parts_beside(
    placements: Array,
    shapes: Array,
    bounds: Array,
    cameras: Array,
    positions: Array32,
    points: Array32,
    parts: Integers,
    counts: Integers,
    step_m: float,
    found: Integers,
) -> None:
    """The part seen at the `SPOTS` outside of each contour sample of many poses.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres.
        shapes: (P, 7) packed superquadrics.
        bounds: (3, P), see `place_solids`.
        cameras: (V, 29) from `Rig.packed`.
        positions, points, parts, counts: of `Contours`.
        step_m: see `Rule`.
        found: (B, V, M, 2) output, -1 where no other part is seen.
    """
    solids = np.zeros((len(shapes), solid.N_COLUMNS), dtype=np.float32)
    everything, spots = np.ones(len(shapes), dtype=np.bool_), np.zeros((1, 2, 5))
    near = np.zeros(len(shapes), dtype=np.int64)
    for b in range(len(placements)):
        place_solids(placements, b, shapes, bounds, solids)
        for v in range(len(cameras)):
            view_solids(shapes, bounds, cameras[v], 0.0, solids)
            last = n = BACKGROUND
            for m in range(counts[b, v]):
                found[b, v, m, 0] = found[b, v, m, 1] = BACKGROUND
                if positions[b, v, m, sample.LENGTH] > 0.0:
                    point = float(points[b, v, m, 0]), float(points[b, v, m, 1]), float(points[b, v, m, 2])
                    normal = float(positions[b, v, m, 2]), float(positions[b, v, m, 3])
                    place_spots(cameras, v, point, normal, step_m, spots, 0)
                    if parts[b, v, m] != last:
                        last = parts[b, v, m]
                        n = parts_near(solids, everything, last, cameras[v, FX], step_m, near)
                    for k in range(2):
                        found[b, v, m, k] = nearest_beside(solids, near, n, spots, (0, k), (BACKGROUND, np.inf))[0]
