"""Pictures of posed bodies: which part is seen at a pixel, and how much of a silhouette is covered."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Integers, Mask

# What of weighted pictures a body covers, for many poses: the silhouettes are filled small and never kept.
#
# Parts that stand still in a batch are filled once for all poses, and not even once if they stand as in the batch
# before; where those are that stand as in the pose before is not found anew.


def cover_still(
    placements: Array,
    still: Mask,
    grids: Array32,
    layout: tuple[int, int],
    cameras: Array,
    regions: Integers,
    pictures: Array32,
) -> tuple[Mask, Array]:
    """What the parts that stand still in a search cover, for `covered_sums`.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres; the first one counts.
        still: (P,) the parts.
        grids, layout, cameras, regions, pictures: see `covered_sums`.

    Returns:
        (N,) pixels covered, all views end to end; (V, 2) sums over them.
    """
    covered, sums = np.empty(len(pictures), dtype=np.bool_), np.empty((len(regions), 2))
    native.cover_still(placements, still, grids, layout, cameras, regions, pictures, covered, sums)
    return covered, sums


def covered_sums(
    placements: Array,
    moving: Mask,
    grids: Array32,
    layout: tuple[int, int],
    cameras: Array,
    regions: Integers,
    pictures: Array32,
    still: tuple[Mask, Array],
) -> Array:
    """Sums of two pictures over what a body covers; the twin is `fill_parts` and a sum.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres.
        moving: (P,) parts that do not stand still.
        grids: (P, R * C, 3) surface points of each part, ring by ring.
        layout: R, C of the grids.
        cameras: (V, 29) from `Rig.packed`, of the small pictures.
        regions: (V, 3) start in `pictures`, width, height; width 0 for a view that does not count.
        pictures: (N, 2) both pictures of all views end to end.
        still: of the other parts, from `cover_still`.

    Returns:
        (B, V, 2) sums; 0 for views that do not count.
    """
    sums = np.empty((len(placements), len(regions), 2))
    native.covered_sums(placements, moving, grids, layout, cameras, regions, pictures, *still, sums)
    return sums


def cover_shares(mask: Mask, factor: int, shares: Array32) -> None:
    """Share (h, w) of each square of `factor` pixels along its side that a mask (H, W) covers."""
    native.cover_shares(mask, factor, shares)


# Contour samples from pictures of part numbers and depths.
#
# A pixel lies on its part's contour if one of its four neighbours shows the background or something farther away. In a
# round window about it, what shows the part is inside and what lies farther away is outside; whatever is nearer hides
# both and counts for neither. The centres of both sides give the normal, the share of the inside gives the distance of
# the contour from the pixel's centre. `tracker/synthesis/_shaders/edges.glsl` is this file for a graphics card.


def id_contours(
    ids: Integers,
    depths: Array32,
    frame: tuple[int, int, int, int],
    camera: Array,
    solids: Array,
    contact_m: float,
    positions: Array32,
    points: Array32,
    parts: Integers,
    between: Mask,
) -> int:
    """Contour samples, one for each pixel on a part's contour.

    Args:
        ids: (h, w) scene-wide part number, -1 for the background.
        depths: (h, w) metres, where there is a part.
        frame: x, y of the picture's first pixel in the image, width and height of the image, px. The image shows
            nothing but background around the picture.
        camera: (29,) row of `Rig.packed`.
        solids: (P, 17) motion (3x4) from the world into the part's frame in units of its half extents, tapers,
            exponents 2/e2, e2/e1 and 2/e1.
        contact_m: distance at which parts touch, metres.
        positions, points, parts, between: outputs for M samples, laid out as in `Contours`.

    Returns:
        Samples found; those beyond M are not written.
    """
    samples = positions, points, parts, between
    return native.id_contours(ids, depths, frame, camera, solids, contact_m, *samples)


# Which of the parts before a camera is the nearest, pixel by pixel: a small depth buffer.


def project_surfaces(placements: Array, surfaces: Array, wanted: Mask, camera: Array, seen: Array) -> None:
    """Images of the points of parts.

    Args:
        placements: (P, 4, 4) world_from_part, metres.
        surfaces: (P, N, 3) points in the parts' frames, metres.
        wanted: (P,) parts that are meant.
        camera: (29,) row of `Rig.packed`.
        seen: (P, 3, N) output: pixels and inverse depths, 1 / m; NaN for parts that are not meant, or not wholly before
            the camera.
    """
    native.project_surfaces(placements, surfaces, wanted, camera, seen)


def draw_nearest(
    seen: Array, triangles: Integers, corner: tuple[int, int], depths: Array32, parts: NDArray[np.int16]
) -> None:
    """Draws the sides of parts that face the camera; inverse depths are linear in the image but for the lens.

    Args:
        seen: (P, 3, N) from `project_surfaces`.
        triangles: (T, 3) point numbers, anticlockwise seen from outside.
        corner: x, y of the pictures' first pixel in the image.
        depths: (h, w) in and out: inverse depth, 1 / m, 0 where there is nothing.
        parts: (h, w) in and out: number of the part.
    """
    native.draw_nearest(seen, triangles, corner, depths, parts)


def rasterize(pixels: Array, depths: Array, triangles: Integers, origin: tuple[int, int], buffers: Array32) -> None:
    """Draws triangles into a depth buffer with perspective-correct interpolation.

    Args:
        pixels: (N, 2) vertices in the image, px.
        depths: (N,) their depths, metres.
        triangles: (T, 3) vertex indices.
        origin: x, y of the buffer's first pixel in the image, px.
        buffers: (h, w, 4) in and out: inverse depth (0 where empty), triangle index, and the barycentric weights of
            its first two vertices.
    """
    native.rasterize(pixels, depths, triangles, origin, buffers)


def covered_by_rods(starts: Array32, ways: Array32, reach_px: Array32, pixels: Array32, shares: Array) -> None:
    """Writes the share of some pixels that poses cover.

    Args:
        starts: (B, P, 2) one end of each part, px; NaN covers nothing.
        ways: (B, P, 2) from there to the other end.
        reach_px: (B, P) how far from the line between them a part reaches.
        pixels: (N, 2).
        shares: (B,) written.
    """
    native.covered_by_rods(starts, ways, reach_px, pixels, shares)


def fill_parts(placements: Array, grids: Array32, layout: tuple[int, int], camera: Array, mask: Mask) -> None:
    """Sets the pixels whose centres the parts cover: row by row, between the outermost lines of their grids.

    Lines that lie inside are not even projected: 4 of 5 at 25 x 48 points, a quarter of the time with all of them.

    Args:
        placements: (P, 4, 4) world_from_part, metres.
        grids: (P, F, 7) surface points first; see `tracker.kernels.descent.Tracing`.
        layout: R, C of the grids, with F = (2 R - 1) (2 C) and 2 C at most 62.
        camera: (29,) row of `Rig.packed`.
        mask: (h, w) in and out; parts that come nearer to the camera than 5 cm, or that are not wholly within the reach
            of its lens, are left out, as in all other pictures.
    """
    native.fill_parts(placements, grids, layout, camera, mask)
