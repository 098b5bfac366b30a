"""Segments of constant curvature: chains of edge pixels split where their curvature changes."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Array32
from tracker.kernels.compilation import compiled
from tracker.kernels.images.linking import Pixels


@compiled
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
    reach, tolerance, shortest = rule
    table = _angle_table(reach)
    angles = np.empty(len(points), dtype=np.float32)
    stack = np.empty((64, 2), dtype=np.int64)
    n_segments = 0
    for chain in range(n_chains):
        first, last = starts[chain], starts[chain + 1]
        if last - first < shortest:
            segments[first:last] = -1
            continue
        _tangent_angles(points, first, last, table, angles)
        stack[0, 0], stack[0, 1] = first, last
        depth = 1
        while depth > 0:
            depth -= 1
            low, high = stack[depth, 0], stack[depth, 1]
            slope = (angles[high - 1] - angles[low]) / max(high - 1 - low, 1)
            worst, where = 0.0, -1
            for i in range(low + 1, high - 1):
                departure = abs(angles[i] - angles[low] - slope * (i - low))
                if departure > worst:
                    worst, where = departure, i
            if worst > tolerance and high - low >= 2 * shortest and depth < 62:
                where = min(max(where, low + shortest), high - shortest)
                stack[depth, 0], stack[depth, 1] = where, high
                stack[depth + 1, 0], stack[depth + 1, 1] = low, where
                depth += 2
                continue
            segments[low:high] = n_segments
            n_segments += 1
    return n_segments


@compiled
def _angle_table(reach: int) -> Array:
    """Angles of all vectors of up to 2 reach px in x and y, which lead from one point of a chain to another."""
    size = 4 * reach + 1
    table = np.empty((size, size))
    for y in range(size):
        for x in range(size):
            table[y, x] = np.arctan2(float(y - 2 * reach), float(x - 2 * reach))
    return table


@compiled
def _tangent_angles(points: Pixels, first: int, last: int, table: Array, angles: Array32) -> None:
    """Unwrapped tangent angle at each point of a chain, over `reach` pixels to both sides."""
    middle = len(table) // 2
    reach = middle // 2
    turn = 0.0
    before = 0.0
    for i in range(first, last):
        a, b = max(first, i - reach), min(last - 1, i + reach)
        angle = table[points[b, 1] - points[a, 1] + middle, points[b, 0] - points[a, 0] + middle]
        if i > first:
            step = angle + turn - before
            if step > np.pi:
                turn -= 2.0 * np.pi
            elif step < -np.pi:
                turn += 2.0 * np.pi
        before = angle + turn
        angles[i] = before
