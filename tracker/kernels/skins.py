"""Kernels of skins: triangle meshes that move with the parts of a body."""

from __future__ import annotations

from typing import NamedTuple

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Integers, Mask


class Mesh(NamedTuple):
    """Triangles that move with the parts of a scene; what is seen of all persons in one value."""

    points: Array32
    """(N, 3) vertices in the pose that the surface was measured in, metres."""

    normals: Array32
    """(N, 3) unit normals of the surface there, outwards."""

    bones: Integers
    """(N, K) scene-wide parts that move a vertex, the strongest first."""

    weights: Array32
    """(N, K) how much each of them does; they add up to 1."""

    faces: Integers
    """(T, 3) vertex numbers, anticlockwise seen from outside."""

    parts: Integers
    """(T,) scene-wide part that a face belongs to."""

    borders: Integers
    """(E, 4) edges of a single face: both ends, the third corner of the face, and the face."""

    n_traced: int
    """So many faces, the first ones, have contours; the others only hide what is behind them."""

    n_parts: int
    """Parts of the scene."""


# Visible occluding-contour samples of skinned meshes, without rendering a picture.
#
# The contour of the smooth surface (`smooth_contours`) is followed across the faces of a mesh, cut into samples of
# equal length, and tested for visibility (`visibility`). Open borders of faces seen from outside are contours as well.


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


def fill_mesh(points: Array, faces: Integers, camera: Array, mask: Mask) -> None:
    """Sets the pixels whose centres triangles cover, from whichever side they are seen.

    Args:
        points: (N, 3) vertices, world, metres.
        faces: (T, 3) vertex numbers.
        camera: (29,) row of `Rig.packed`.
        mask: (h, w) in and out; triangles that are not wholly before the camera are left out.
    """
    native.fill_mesh(points, faces, camera, mask)
