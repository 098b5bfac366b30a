"""Where viewing rays first meet the surface of a part that is known to be seen there."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array, Integers


def meet_parts(placements: Array, shapes: Array, centre: Array, rays: Array, parts: Integers, found: Array) -> None:
    """The first crossing of each ray with one part.

    Args:
        placements: (P, 4, 4) world_from_part.
        shapes: (P, 7) packed superquadrics.
        centre: (3,) where the rays start, metres.
        rays: (N, 3) unit vectors in the world.
        parts: (N,) which part each of them is to meet.
        found: (N, 10) output, a row each; `tracker.kernels.rows.met_place` names the columns.
    """
    native.meet_parts(placements, shapes, centre, rays, parts, found)
