"""Which part of a scene is seen beside a contour: an arm before the trunk has the trunk for its background."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Integers


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
    samples = positions, points, parts, counts
    native.parts_beside(placements, shapes, bounds, cameras, *samples, step_m, found)
