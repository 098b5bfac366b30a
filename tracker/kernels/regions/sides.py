"""Which part of a scene is seen beside a contour: an arm before the trunk has the trunk for its background."""

from __future__ import annotations

from typing import Any

import numpy as np

from tracker.arrays import Array, Array32, Integers
from tracker.kernels.compilation import compiled
from tracker.kernels.contours.occlusion import beside, blocks_ray, in_part, place_solids, view_solids
from tracker.kernels.projection import project_along
from tracker.kernels.regions.lines import BACKGROUND, SPOTS, pixels_per_metre
from tracker.kernels.rows import sample, solid
from tracker.kernels.rows.camera import CENTRE_X, CENTRE_Y, CENTRE_Z

_FAR = 3.0
"""Rays are followed to this many times the distance of the contour: through all that may lie behind it."""

_single: Any = np.float32
"""As the other ray tests have it: in double precision they would be compiled once more."""


@compiled
def _nearest_on_ray(solids: Array32, p: int, pixel: tuple[float, float], far: tuple[float, float, float]) -> int:
    """The part, other than p, that a ray to a far world point meets first: the one whose middle it passes first."""
    found, least = BACKGROUND, np.inf
    x, y, z = far
    for q in range(len(solids)):
        if q == p or solids[q, solid.NEAREST] < 0.0 or beside(solids, q, pixel[0], pixel[1]) > solids[q, solid.WIDTH2]:
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
    return found


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

    A spot is reached in space: the point on the contour moved across its viewing ray until its image has moved.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres.
        shapes: (P, 7) packed superquadrics.
        bounds: (3, P), see `place_solids`.
        cameras: (V, 25) from `Rig.packed`.
        positions, points, parts, counts: of `Contours`.
        step_m: see `Rule`.
        found: (B, V, M, 2) output, -1 where no other part is seen.
    """
    solids = np.zeros((len(shapes), solid.N_COLUMNS), dtype=np.float32)
    for b in range(len(placements)):
        place_solids(placements, b, shapes, bounds, solids)
        for v in range(len(cameras)):
            view_solids(shapes, bounds, cameras[v], 0.0, solids)
            for m in range(counts[b, v]):
                found[b, v, m, 0] = found[b, v, m, 1] = BACKGROUND
                if positions[b, v, m, sample.LENGTH] > 0.0:
                    point = float(points[b, v, m, 0]), float(points[b, v, m, 1]), float(points[b, v, m, 2])
                    normal = float(positions[b, v, m, 2]), float(positions[b, v, m, 3])
                    for k in range(2):
                        spot = SPOTS[k]
                        found[b, v, m, k] = _part_at(solids, parts[b, v, m], cameras, v, point, normal, spot, step_m)


@compiled
def _part_at(
    solids: Array32,
    p: int,
    cameras: Array,
    v: int,
    point: tuple[float, float, float],
    normal: tuple[float, float],
    spot: float,
    step_m: float,
) -> int:
    """The part seen some steps outside of a contour point of part p."""
    x, y, z = point
    u, w, sx, sy, sz = project_along(cameras, v, point, normal)
    step = max(pixels_per_metre(cameras[v], x, y, z) * step_m, 1.0)
    move = spot * step / (sx * sx + sy * sy + sz * sz)
    cx, cy, cz = cameras[v, CENTRE_X], cameras[v, CENTRE_Y], cameras[v, CENTRE_Z]
    far = cx + _FAR * (x + move * sx - cx), cy + _FAR * (y + move * sy - cy), cz + _FAR * (z + move * sz - cz)
    pixel = u + spot * step * normal[0], w + spot * step * normal[1]
    return _nearest_on_ray(solids, p, pixel, far)
