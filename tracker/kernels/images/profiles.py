"""Where an edge lies between its pixels, and which way its gradient points."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array32
from tracker.kernels.images.linking import Pixels
from tracker.kernels.images.slopes import Slopes


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
