"""Parts of a body that run through each other."""

from __future__ import annotations

from typing import Any

import numpy as np

from tracker.arrays import Array, Integers
from tracker.kernels.compilation import compiled
from tracker.kernels.contours.occlusion import SOLID_COLUMNS, inside_value, place_solids

_N_POINTS = 5


@compiled
def count_collisions(placements: Array, shapes: Array, pairs: Integers) -> Array:
    """Points on the axes of parts that lie inside other parts, five to a part.

    Touching surfaces do not count: only what runs through another part does.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres.
        shapes: (P, 7) packed superquadrics.
        pairs: (N, 2) parts that must not run through each other.

    Returns:
        (B,) number of points.
    """
    counts = np.zeros(len(placements))
    bounds = np.ones((3, len(shapes)))
    solids = np.zeros((len(shapes), SOLID_COLUMNS), dtype=np.float32)
    for b in range(len(placements)):
        place_solids(placements, b, shapes, bounds, solids)
        for i in range(len(pairs)):
            for k in range(2):
                p, q = pairs[i, k], pairs[i, 1 - k]
                half = shapes[p, 2]
                for n in range(_N_POINTS):
                    t = half * (1.6 * n / (_N_POINTS - 1) - 0.8)
                    x = solids[p, 38] + t * solids[p, 31]
                    y = solids[p, 39] + t * solids[p, 34]
                    z = solids[p, 40] + t * solids[p, 37]
                    u: Any = np.float32(solids[q, 0] * x + solids[q, 1] * y + solids[q, 2] * z + solids[q, 3])
                    v: Any = np.float32(solids[q, 4] * x + solids[q, 5] * y + solids[q, 6] * z + solids[q, 7])
                    w: Any = np.float32(solids[q, 8] * x + solids[q, 9] * y + solids[q, 10] * z + solids[q, 11])
                    inside = inside_value(solids, q, u, v, w)
                    counts[b] += 1.0 if inside < 1.0 else 0.0
    return counts
