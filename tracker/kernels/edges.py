"""Edges of images: slopes, chains of edge pixels, their segments, and the distance to the next edge."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import tracker._native as native
from tracker.foundation.arrays import Array32, Image, Integers, Mask

# Gradients of colour images.

Slopes = NDArray[np.int16]
"""Differences (h, w) across two pixels by a Sobel filter: eighths of a grey level per pixel."""


def strongest_slopes(image: Image, dx: Slopes, dy: Slopes) -> None:
    """Sobel gradient of the channel that changes most, measured by abs(dx) + abs(dy); the first of equals.

    In one pass, for the memory is slower than the arithmetic: 0.6 ms for four views, where a gradient of every
    channel and then a choice take 1.3.

    Args:
        image: (h, w, 3); mirrored at the border, at least 2 px wide and high.
        dx, dy: (h, w) output.
    """
    native.strongest_slopes(image, dx, dy)


# Edge linking: chains of neighbouring edge pixels.

Pixels = NDArray[np.int32]
"""(N, 2) x, y; or (N,) indices. Half the memory traffic of `Integers`."""


def link_edges(edges: Image, points: Pixels, starts: Pixels) -> int:
    """Links edge pixels into 8-connected chains; each pixel belongs to one chain.

    Args:
        edges: (h + 2, w + 2) non-zero at edge pixels, with an empty border, contiguous; cleared by the linking.
        points: (N, 2) output: x, y of all edge pixels, without the border, chain after chain.
        starts: (N + 1,) output: first point of each chain.

    Returns:
        Number of chains.
    """
    return native.link_edges(edges, points, starts)


def trace_segments(
    edges: Image,
    slopes: tuple[Slopes, Slopes],
    rule: tuple[int, float, int],
    near: Image,
    found: tuple[Array32, Array32, Integers],
) -> tuple[int, int]:
    """Links edge pixels, splits the chains and finds the sub-pixel profile of the segments that are long enough.

    Segments that matter to nobody are left out early: four of five edges around a person are the room's.

    Args:
        edges: (h + 2, w + 2) non-zero at the N edge pixels, with an empty border; cleared.
        slopes: dx, dy (h, w) image gradient.
        rule: see `split_segments`.
        near: (h, w) non-zero where edges matter: segments without such a pixel are left out; (0, 0) for all of them.
        found: output: positions (N, 2) px, unit gradients (N, 2) and segments (N,).

    Returns:
        Number of points of segments, which stand first in the output, and number of segments.
    """
    positions, directions, segments = found
    return native.trace_segments(edges, *slopes, rule, near, positions, directions, segments)


def split_segments(
    points: Pixels, starts: Pixels, n_chains: int, rule: tuple[int, float, int], segments: Pixels
) -> int:
    """Splits chains where their curvature changes.

    Along an arc of constant curvature the tangent angle grows linearly with arc length: each chain's angle is
    approximated by straight pieces (Ramer-Douglas-Peucker), one piece a segment.

    Args:
        points, starts, n_chains: chains from `link_edges`.
        rule: pixels to each side over which the tangent is taken; largest departure of the tangent angle from
            a straight line, rad; least number of points of a segment.
        segments: (N,) output: segment of each point, -1 in segments that are too short.

    Returns:
        Number of segments.
    """
    return native.split_segments(points, starts, n_chains, rule, segments)


def edge_profile(points: Pixels, slopes: tuple[Slopes, Slopes], edges: Array32, directions: Array32) -> None:
    """Sub-pixel positions and gradient directions of edge pixels.

    A parabola goes through the slope, along the gradient's direction, of the pixel and its two neighbours in the
    row or column that the gradient is nearest to; its vertex lies on the edge, whose nearest point is the position.
    Neighbours interpolated along the gradient itself would be smoother than the pixel and draw the vertex to it:
    twice the error on slanted edges.

    Args:
        points: (N, 2) edge pixels x, y.
        slopes: dx, dy (h, w) image gradient.
        edges: (N, 2) output: positions, px.
        directions: (N, 2) output: unit gradient.
    """
    native.edge_profile(points, *slopes, edges, directions)


def chamfer_distances(pixels: NDArray[np.int32], reach: float, distance: Array32) -> None:
    """Distance of every pixel to the nearest of some pixels along the steps of a 5 x 5 mask.

    The steps of a shortest way may come in any order: all that lead along the row come first, so that they are
    drawn around each pixel, and the others lead down or up only. Nothing then depends on the pixel before in the
    same row, and each row is worked on in vectors: 0.12 ms for 400 x 400 px where `cv2.distanceTransform`, which
    goes from pixel to pixel, takes 0.7 ms.

    Args:
        pixels: (N, 2) x, y of the pixels of distance 0.
        reach: largest value, px.
        distance: (h, w) output, px.
    """
    native.chamfer_distances(pixels, reach, distance)


# What accepting segments as units needs of each edge: distance to the expected contours, marks in pictures.


def marked(points: Array32, picture: Image, origin: tuple[int, int], marks: Mask) -> None:
    """Which points a picture is set at; beyond the picture it is not.

    Args:
        points: (N, 2) px of the whole image.
        picture: (h, w).
        origin: pixel (x, y) of its upper left corner.
        marks: (N,) output.
    """
    native.marked(points, picture, origin, marks)


def expected_distances(
    edges: Array32, directions: Array32, samples: Array32, bend_px: float, most_px: float
) -> Array32:
    """Distance of each edge point to the nearest expected contour sample, clamped.

    A sample whose normal is at angle a to the gradient is farther by ``bend_px |sin a|``: lines across a limb
    do not count as its contour. Any order of the edges gives the same distances; in chains, where neighbours
    follow each other, few samples are compared.

    Args:
        edges: (N, 2) px.
        directions: (N, 2) unit gradients.
        samples: (M, 4) pixel and unit normal.
        bend_px: distance that a right angle between the directions counts, px.
        most_px: largest value, px; also where there is no sample.

    Returns:
        (N,) px.
    """
    distances = np.empty(len(edges), dtype=np.float32)
    native.expected_distances(edges, directions, samples, bend_px, most_px, distances)
    return distances
