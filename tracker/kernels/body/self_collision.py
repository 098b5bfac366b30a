"""Parts of a body that run through each other."""

from __future__ import annotations

import numpy as np

import tracker._native as native
from tracker.foundation.arrays import Array, Integers

POINTS_A_PART = 5
"""Along the middle 80 % of an axis: joints overlap by design."""


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
    sums = np.empty(len(placements))
    native.sum_collisions(placements, shapes, pairs, sums)
    return sums


def depth(shape: Array, u: float, v: float, w: float) -> float:
    """How deep a point lies inside a part: 0 at its surface, 1 on its axis, along the line between them across it.

    Args:
        shape: (7,) packed superquadric.
        u, v, w: position in the part's frame divided by a1, a2, a3; inside.
    """
    return native.depth(shape, u, v, w)
