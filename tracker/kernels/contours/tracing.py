"""Visible occluding-contour samples of tapered superquadrics, without rendering a picture.

The pieces of contour of each part are found on its surface grid (`contour_pieces`), cut into samples of equal
length, bent by the turn of their normals, and tested for visibility (`occlusion`). The cost does not depend on the
image size.
"""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Integers, Mask


def trace_contours(
    placements: Array,
    shapes: Array,
    grids: Array32,
    planes: Array32,
    layout: tuple[int, int],
    bounds: Array,
    cameras: Array,
    sizes: Array,
    spacing: tuple[float, float],
    exact: bool,
    positions: Array32,
    points: Array32,
    parts: Integers,
    between: Mask,
    counts: Integers,
) -> int:
    """Visible occluding-contour samples of many poses in all views.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres.
        shapes: (P, 7) packed superquadrics.
        grids, planes, layout: surface grids, see `find_pieces`.
        bounds: (3, P), see `place_solids`.
        cameras: (V, 29) from `Rig.packed`.
        sizes: (V, 2) image sizes, px.
        spacing: contour a sample stands for, px; distance at which parts touch, metres.
        exact: place pixels where the points are seen, or else where they are traced, as `score_poses` does: bent in
            the image and in space, a sample's pixel and point are up to 0.05 px apart.
        positions: (B, V, M, 5) output: pixel, image normal, contour length.
        points: (B, V, M, 3) output: world positions.
        parts, between, counts: outputs, laid out as in `Contours`.

    Returns:
        Most samples traced in a view; with M there may be more. Of these `exact` may place some outside of the image.
    """
    return native.trace_contours(
        placements,
        shapes,
        grids,
        planes,
        layout,
        bounds,
        cameras,
        sizes,
        spacing,
        exact,
        positions,
        points,
        parts,
        between,
        counts,
    )
