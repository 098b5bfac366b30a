"""Which part of a scene is seen beside a contour: an arm before the trunk has the trunk for its background."""

from __future__ import annotations

from typing import Any

import numpy as np

from tracker.arrays import Array, Array32, Integers
from tracker.kernels.compilation import compiled
from tracker.kernels.occlusion import SOLID_COLUMNS, beside, blocks_ray, place_solids, view_solids
from tracker.kernels.projection import project_along
from tracker.kernels.region_lines import BACKGROUND, SPOTS, Samples, pixels_per_metre

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
        if q == p or solids[q, 28] < 0.0 or beside(solids, q, pixel[0], pixel[1]) > solids[q, 27]:
            continue
        a = solids[q, 0] * x + solids[q, 1] * y + solids[q, 2] * z + solids[q, 3]
        b = solids[q, 4] * x + solids[q, 5] * y + solids[q, 6] * z + solids[q, 7]
        c = solids[q, 8] * x + solids[q, 9] * y + solids[q, 10] * z + solids[q, 11]
        if not blocks_ray(solids, q, _single(a), _single(b), _single(c)):
            continue
        da, db, dc = a - solids[q, 12], b - solids[q, 13], c - solids[q, 14]
        along = -(solids[q, 12] * da + solids[q, 13] * db + solids[q, 14] * dc) / (da * da + db * db + dc * dc)
        if along < least:
            found, least = q, along
    return found


@compiled
def parts_beside(
    placements: Array, shapes: Array, bounds: Array, cameras: Array, samples: Samples, step_m: float, found: Integers
) -> None:
    """The part seen at the `SPOTS` outside of each contour sample of one pose.

    A spot is reached in space: the point on the contour moved across its viewing ray until its image has moved.

    Args:
        placements: (1, P, 4, 4) world_from_part, metres.
        shapes: (P, 7) packed superquadrics.
        bounds: (3, P), see `place_solids`.
        cameras: (V, 25) from `Rig.packed`.
        samples: contour samples.
        step_m: see `Rule`.
        found: (V, M, 2) output, -1 where no other part is seen.
    """
    solids = np.zeros((len(shapes), SOLID_COLUMNS), dtype=np.float32)
    place_solids(placements, 0, shapes, bounds, solids)
    for v in range(len(cameras)):
        camera = cameras[v]
        view_solids(shapes, bounds, camera, 0.0, solids)
        for m in range(samples.counts[v]):
            found[v, m, 0] = found[v, m, 1] = BACKGROUND
            if samples.positions[v, m, 4] <= 0.0:
                continue
            x, y, z = float(samples.points[v, m, 0]), float(samples.points[v, m, 1]), float(samples.points[v, m, 2])
            normal = float(samples.positions[v, m, 2]), float(samples.positions[v, m, 3])
            u, w, sx, sy, sz = project_along(cameras, v, (x, y, z), normal)
            step = max(pixels_per_metre(camera, x, y, z) * step_m, 1.0)
            square = sx * sx + sy * sy + sz * sz
            for k in range(2):
                move = SPOTS[k] * step / square
                far = (
                    camera[12] + _FAR * (x + move * sx - camera[12]),
                    camera[13] + _FAR * (y + move * sy - camera[13]),
                    camera[14] + _FAR * (z + move * sz - camera[14]),
                )
                pixel = u + SPOTS[k] * step * normal[0], w + SPOTS[k] * step * normal[1]
                found[v, m, k] = _nearest_on_ray(solids, samples.parts[v, m], pixel, far)
