"""Segments of constant curvature: chains of edge pixels split where their curvature changes."""

from __future__ import annotations

import tracker._native as native
from tracker.kernels.images.linking import Pixels


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
