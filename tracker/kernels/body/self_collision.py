"""Parts of a body that run through each other."""

from __future__ import annotations

from typing import Any

import numpy as np

from tracker.arrays import Array, Integers
from tracker.kernels.compilation import compiled
from tracker.kernels.contours.solids import in_part, inside_value, place_solids
from tracker.kernels.rows import solid, superquadric

POINTS_A_PART = 5
"""Along the middle 80 % of an axis: joints overlap by design."""

# Of a part's radius: flesh and clothes give way, and shapes are good to a centimetre or two. With every point counting
# in full a hand on the hip cost 0.4 px, and the forearm was put behind the back (T-Punch-light, 18 frames of 80).
_SHALLOW = 0.25

_single: Any = np.float32
"""As the ray tests have it: in double precision `inside_value` would be compiled once more."""


@compiled
def sum_collisions(placements: Array, shapes: Array, pairs: Integers) -> Array:
    """Points on the axes of parts that lie inside other parts, five to a part, by how deep they lie.

    Surfaces that touch count for nothing, and what is deep inside another part for one a point.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres.
        shapes: (P, 7) packed superquadrics.
        pairs: (N, 2) parts that must not run through each other.

    Returns:
        (B,) sums over the points.
    """
    sums = np.zeros(len(placements))
    bounds = np.ones((3, len(shapes)))
    solids = np.zeros((len(shapes), solid.N_COLUMNS), dtype=np.float32)
    for b in range(len(placements)):
        place_solids(placements, b, shapes, bounds, solids)
        for i in range(len(pairs)):
            for k in range(2):
                p, q = pairs[i, k], pairs[i, 1 - k]
                half = shapes[p, superquadric.A3]
                for n in range(POINTS_A_PART):
                    t = half * (1.6 * n / (POINTS_A_PART - 1) - 0.8)
                    x = solids[p, solid.X] + t * solids[p, solid.R13]
                    y = solids[p, solid.Y] + t * solids[p, solid.R23]
                    z = solids[p, solid.Z] + t * solids[p, solid.R33]
                    u, v, w = in_part(solids, q, x, y, z)
                    if inside_value(solids, q, _single(u), _single(v), _single(w)) < 1.0:
                        sums[b] += min(depth(shapes[q], u, v, w) / _SHALLOW, 1.0)
    return sums


@compiled
def depth(shape: Array, u: float, v: float, w: float) -> float:
    """How deep a point lies inside a part: 0 at its surface, 1 on its axis, along the line between them across it.

    Args:
        shape: (7,) packed superquadric.
        u, v, w: position in the part's frame divided by a1, a2, a3; inside.
    """
    e1, e2 = shape[superquadric.E1], shape[superquadric.E2]
    across = abs(u / (1.0 + shape[superquadric.K1] * w)) ** (2.0 / e2)
    across += abs(v / (1.0 + shape[superquadric.K2] * w)) ** (2.0 / e2)
    room = 1.0 - abs(w) ** (2.0 / e1)
    if room <= 0.0:
        return 0.0
    return max(1.0 - (across ** (e2 / e1) / room) ** (0.5 * e1), 0.0)
