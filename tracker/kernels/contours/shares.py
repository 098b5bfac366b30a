"""How much of a pose's contours lies on edges, and how much of the edges no contour explains."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Integers


def edge_shares(
    positions: Array32,
    parts: Integers,
    counts: Integers,
    flat: Array32,
    regions: Integers,
    scene: Array32,
    first: Integers,
    reach: Array32,
    near_px: tuple[float, float],
    sums: Array,
) -> None:
    """Adds up over all views what the contours of one pose and the edges leave of each other.

    Args:
        positions: (V, M, 5) contour samples from `Contours`; those of length 0 explain edges and count as none, as
            do those where the chamfer image is negative, for something hides them.
        parts: (V, M) part of each.
        counts: (V,) valid ones.
        flat, regions, scene, first, reach: the observation, from `Observation.packed`.
        near_px: how close to an edge a sample counts as explained, and how far from all samples an edge as missed.
        sums: (4, V, P) output, px: visible contour; times its distance to the edges; explained; length of edges far
            from all samples, by the part of the nearest.
    """
    native.edge_shares(positions, parts, counts, flat, regions, scene, first, reach, near_px, sums)
