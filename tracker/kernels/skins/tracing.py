"""Visible occluding-contour samples of skinned meshes, without rendering a picture.

The contour of the smooth surface (`smooth_contours`) is followed across the faces of a mesh, cut into samples of equal
length, and tested for visibility (`visibility`). Open borders of faces seen from outside are contours as well.
"""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Integers, Mask
from tracker.kernels.skins.mesh import Mesh


def trace_skins(
    placements: Array,
    part_from_rest: Array,
    mesh: Mesh,
    cameras: Array,
    sizes: Array,
    spacing: tuple[float, float, float],
    positions: Array32,
    points: Array32,
    parts: Integers,
    between: Mask,
    counts: Integers,
) -> None:
    """Visible occluding-contour samples of meshes that move with the parts of many poses, in all views.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres.
        part_from_rest: (P, 4, 4) from the pose that the surface was measured in.
        mesh: of the scene.
        cameras: (V, 29) from `Rig.packed`.
        sizes: (V, 2) image sizes, px.
        spacing: contour a sample stands for, px; distance at which surfaces touch, metres; cells of the depth
            pictures along the longer side of an image.
        positions, points, parts, between, counts: outputs, laid out as in `Contours`.
    """
    samples = positions, points, parts, between, counts
    native.trace_skins(placements, part_from_rest, mesh, cameras, sizes, spacing, *samples)
