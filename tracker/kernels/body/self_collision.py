"""Parts of a body that run through each other."""

from __future__ import annotations

from typing import Any

import numpy as np

from tracker.arrays import Array, Integers
from tracker.kernels.compilation import compiled
from tracker.kernels.contours.occlusion import in_part, inside_value, place_solids
from tracker.kernels.rows import solid, superquadric

# Along the middle 80 % of an axis: joints overlap by design.
_N_POINTS = 5

_single: Any = np.float32
"""As the ray tests have it: in double precision `inside_value` would be compiled once more."""


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
    solids = np.zeros((len(shapes), solid.N_COLUMNS), dtype=np.float32)
    for b in range(len(placements)):
        place_solids(placements, b, shapes, bounds, solids)
        for i in range(len(pairs)):
            for k in range(2):
                p, q = pairs[i, k], pairs[i, 1 - k]
                half = shapes[p, superquadric.A3]
                for n in range(_N_POINTS):
                    t = half * (1.6 * n / (_N_POINTS - 1) - 0.8)
                    x = solids[p, solid.X] + t * solids[p, solid.R13]
                    y = solids[p, solid.Y] + t * solids[p, solid.R23]
                    z = solids[p, solid.Z] + t * solids[p, solid.R33]
                    u, v, w = in_part(solids, q, x, y, z)
                    inside = inside_value(solids, q, _single(u), _single(v), _single(w))
                    counts[b] += 1.0 if inside < 1.0 else 0.0
    return counts
