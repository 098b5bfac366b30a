"""Edge linking and constant-curvature segments (Gavrila & Davis 1996, section 4.2)."""

from __future__ import annotations

import numpy as np
from numba import njit

from tracker.arrays import Array32, Image, Integers


@njit(cache=True, nogil=True, error_model="numpy")
def _next_pixel(edges: Image, x: int, y: int) -> tuple[int, int]:
    """An unvisited 8-neighbour, straight ones first; -1, -1 if there is none."""
    height, width = edges.shape
    for dx, dy in ((1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)):
        u, v = x + dx, y + dy
        if 0 <= u < width and 0 <= v < height and edges[v, u]:
            return u, v
    return -1, -1


@njit(cache=True, nogil=True, error_model="numpy")
def link_edges(edges: Image, points: Integers, starts: Integers) -> int:
    """Links edge pixels into 8-connected chains; each pixel belongs to one chain.

    Args:
        edges: (h, w) non-zero at edge pixels; cleared by the linking.
        points: (N, 2) output: x, y of all edge pixels, chain after chain.
        starts: (N + 1,) output: first point of each chain.

    Returns:
        Number of chains.
    """
    height, width = edges.shape
    n_chains = n = 0
    for y0 in range(height):
        for x0 in range(width):
            if not edges[y0, x0]:
                continue
            starts[n_chains] = n
            begin = n
            x, y = x0, y0
            while x >= 0:
                edges[y, x] = 0
                points[n, 0], points[n, 1] = x, y
                n += 1
                x, y = _next_pixel(edges, x, y)
            x, y = _next_pixel(edges, x0, y0)
            if x >= 0:
                low, high = begin, n - 1
                while low < high:
                    for k in range(2):
                        points[low, k], points[high, k] = points[high, k], points[low, k]
                    low, high = low + 1, high - 1
                while x >= 0:
                    edges[y, x] = 0
                    points[n, 0], points[n, 1] = x, y
                    n += 1
                    x, y = _next_pixel(edges, x, y)
            n_chains += 1
    starts[n_chains] = n
    return n_chains


@njit(cache=True, nogil=True, error_model="numpy")
def _tangent_angles(points: Integers, first: int, last: int, reach: int, angles: Array32) -> None:
    """Unwrapped tangent angle at each point of a chain, over `reach` pixels to both sides."""
    turn = 0.0
    before = 0.0
    for i in range(first, last):
        a, b = max(first, i - reach), min(last - 1, i + reach)
        angle = np.arctan2(float(points[b, 1] - points[a, 1]), float(points[b, 0] - points[a, 0]))
        if i > first:
            step = angle + turn - before
            if step > np.pi:
                turn -= 2.0 * np.pi
            elif step < -np.pi:
                turn += 2.0 * np.pi
        before = angle + turn
        angles[i] = before


@njit(cache=True, nogil=True, error_model="numpy")
def split_segments(
    points: Integers, starts: Integers, n_chains: int, rule: tuple[int, float, int], segments: Integers
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
    angles = np.zeros(len(points), dtype=np.float32)
    stack = np.zeros((64, 2), dtype=np.int64)
    n_segments = 0
    for chain in range(n_chains):
        first, last = starts[chain], starts[chain + 1]
        if last - first < shortest:
            segments[first:last] = -1
            continue
        _tangent_angles(points, first, last, reach, angles)
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


@njit(cache=True, nogil=True, error_model="numpy")
def edge_profile(points: Integers, gradients: Array32, edges: Array32, directions: Array32) -> None:
    """Sub-pixel positions and gradient directions of edge pixels.

    A parabola goes through the slope, along the gradient's direction, of the pixel and its two neighbours in the
    row or column that the gradient is nearest to; its vertex lies on the edge, whose nearest point is the position.
    Neighbours interpolated along the gradient itself would be smoother than the pixel and draw the vertex to it:
    twice the error on slanted edges.

    Args:
        points: (N, 2) edge pixels x, y.
        gradients: (h, w, 2) image gradient.
        edges: (N, 2) output: positions, px.
        directions: (N, 2) output: unit gradient.
    """
    height, width = gradients.shape[:2]
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        gx, gy = gradients[y, x, 0], gradients[y, x, 1]
        here = np.sqrt(gx * gx + gy * gy) + 1e-9
        ux, uy = gx / here, gy / here
        shift = 0.0
        if 0 < x < width - 1 and 0 < y < height - 1:
            dx, dy = (1, 0) if abs(ux) >= abs(uy) else (0, 1)
            before = gradients[y - dy, x - dx, 0] * ux + gradients[y - dy, x - dx, 1] * uy
            after = gradients[y + dy, x + dx, 0] * ux + gradients[y + dy, x + dx, 1] * uy
            curvature = before - 2.0 * here + after
            if curvature < -1e-6:
                vertex = 0.5 * (before - after) / curvature
                # Half a pixel's diagonal: an edge farther away belongs to another pixel.
                shift = min(max(vertex * (dx * ux + dy * uy), -0.71), 0.71)
        edges[i, 0], edges[i, 1] = x + shift * ux, y + shift * uy
        directions[i, 0], directions[i, 1] = ux, uy
