"""What accepting segments as units needs of each edge: distance to the expected contours, marks in pictures."""

from __future__ import annotations

import numpy as np

import tracker._native as native
from tracker.foundation.arrays import Array32, Image, Mask


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
