"""Which part of a body a point lies on."""

from __future__ import annotations

import numpy as np

from tracker.foundation.arrays import Array, Integers
from tracker.foundation.geometry.superquadrics import signed_distance


def nearest_parts(points: Array, placements: Array, shapes: Array) -> tuple[Integers, Array, Array]:
    """The part whose surface is nearest to each point, where parts overlap the outer one.

    Args:
        points: (N, 3) in the world, metres.
        placements: (P, 4, 4) of the parts in the world.
        shapes: (P, 7) packed superquadrics.

    Returns:
        (N,) part; (N,) signed distance from its surface, metres; (N,) how much farther the next part is, metres.
    """
    distances = np.empty((len(shapes), len(points)))
    for p, (placed, shape) in enumerate(zip(placements, shapes, strict=True)):
        distances[p] = signed_distance(shape, (points - placed[:3, 3]) @ placed[:3, :3])[0]
    order = np.sort(distances, axis=0)
    lead = order[1] - order[0] if len(shapes) > 1 else np.full(len(points), np.inf)
    part = distances.argmin(axis=0)
    return part, distances[part, np.arange(len(points))], lead
