"""Edge linking and constant-curvature segments (Gavrila & Davis 1996, section 4.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tracker.arrays import Array, Array32, Image, Integers
from tracker.kernels.compilation import compiled
from tracker.kernels.images.slopes import Slopes

Pixels = NDArray[np.int32]
"""(N, 2) x, y; or (N,) indices. Half the memory traffic of `Integers`."""

# Columns and rows from a pixel to its neighbours, in the order in which a chain goes on: straight ones first.
_RIGHT = 1, 0, -1, 0, 1, -1, -1, 1
_DOWN = 0, 1, 0, -1, 1, 1, -1, -1

# A Sobel filter counts a grey level per pixel eight times.
_PER_SLOPE = np.float32(1 / 8)


@compiled
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
    positions, directions, kept = found
    points = np.empty((len(positions), 2), dtype=np.int32)
    starts = np.empty(len(positions) + 1, dtype=np.int32)
    labels = np.empty(len(positions), dtype=np.int32)
    n_chains = link_edges(edges, points, starts)
    n_chains = _chains_near(points, starts, n_chains, near)
    n_pixels = starts[n_chains]
    split_segments(points, starts, n_chains, rule, labels)
    n = n_segments = i = 0
    while i < n_pixels:
        end = i + 1
        while end < n_pixels and labels[end] == labels[i]:
            end += 1
        if labels[i] >= 0 and _any_near(points, i, end, near):
            for k in range(i, end):
                points[n, 0], points[n, 1] = points[k, 0], points[k, 1]
                kept[n] = n_segments
                n += 1
            n_segments += 1
        i = end
    edge_profile(points[:n], slopes, positions, directions)
    return n, n_segments


@compiled
def _any_near(points: Pixels, first: int, end: int, near: Image) -> bool:
    """Whether one of some pixels is where edges matter; that is everywhere if nothing tells where."""
    matters = near.size == 0
    for i in range(first, end):
        matters = matters or near[points[i, 1], points[i, 0]] != 0
    return matters


@compiled
def _chains_near(points: Pixels, starts: Pixels, n_chains: int, near: Image) -> int:
    """Moves the chains that have a pixel where edges matter to the front; their number."""
    n = n_kept = 0
    for chain in range(n_chains):
        first, end = starts[chain], starts[chain + 1]
        if not _any_near(points, first, end, near):
            continue
        starts[n_kept] = n
        for i in range(first, end):
            points[n, 0], points[n, 1] = points[i, 0], points[i, 1]
            n += 1
        n_kept += 1
    starts[n_kept] = n
    return n_kept


@compiled
def link_edges(edges: Image, points: Pixels, starts: Pixels) -> int:
    """Links edge pixels into 8-connected chains; each pixel belongs to one chain.

    Args:
        edges: (h + 2, w + 2) non-zero at edge pixels, with an empty border, contiguous; cleared by the linking.
        points: (N, 2) output: x, y of all edge pixels, without the border, chain after chain.
        starts: (N + 1,) output: first point of each chain.

    Returns:
        Number of chains.
    """
    width = edges.shape[1]
    flat = edges.reshape(-1)
    # Most pixels are no edges: eight at a time are passed over.
    eights = flat[: flat.size // 8 * 8].view(np.uint64)
    n_chains = n = 0
    for word in range(len(eights) + 1):
        if word < len(eights) and eights[word] == 0:
            continue
        for place in range(8 * word, min(8 * word + 8, flat.size)):
            if flat[place]:
                starts[n_chains] = n
                n = _link_chain(flat, width, place, points, n)
                n_chains += 1
    starts[n_chains] = n
    return n_chains


@compiled
def _link_chain(flat: Image, width: int, place: int, points: Pixels, n: int) -> int:
    """Writes the chain through one pixel to the points from n on; returns its end."""
    begin = n
    n = _walk(flat, width, place, points, n)
    k = _next_neighbour(flat, width, place)
    if k < 0:
        return n
    low, high = begin, n - 1
    while low < high:
        for axis in range(2):
            points[low, axis], points[high, axis] = points[high, axis], points[low, axis]
        low, high = low + 1, high - 1
    return _walk(flat, width, place + _DOWN[k] * width + _RIGHT[k], points, n)


@compiled
def _walk(flat: Image, width: int, place: int, points: Pixels, n: int) -> int:
    """Writes the pixels from one on in one direction, and clears them."""
    # Once: dividing each place by the width would take as long as all else.
    y = place // width
    x, k = place - y * width, 0
    while k >= 0:
        flat[place] = 0
        points[n, 0], points[n, 1] = x - 1, y - 1
        n += 1
        k = _next_neighbour(flat, width, place)
        if k >= 0:
            place, x, y = place + _DOWN[k] * width + _RIGHT[k], x + _RIGHT[k], y + _DOWN[k]
    return n


@compiled
def _next_neighbour(flat: Image, width: int, place: int) -> int:
    """Number of the first unvisited neighbour; -1 if there is none."""
    for k in range(8):
        if flat[place + _DOWN[k] * width + _RIGHT[k]]:
            return k
    return -1


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
    along_x, along_y = slopes
    height, width = along_x.shape
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        gx, gy = _PER_SLOPE * np.float32(along_x[y, x]), _PER_SLOPE * np.float32(along_y[y, x])
        here = np.sqrt(gx * gx + gy * gy) + 1e-9
        ux, uy = gx / here, gy / here
        shift = 0.0
        if 0 < x < width - 1 and 0 < y < height - 1:
            dx, dy = (1, 0) if abs(ux) >= abs(uy) else (0, 1)
            before = _PER_SLOPE * (along_x[y - dy, x - dx] * ux + along_y[y - dy, x - dx] * uy)
            after = _PER_SLOPE * (along_x[y + dy, x + dx] * ux + along_y[y + dy, x + dx] * uy)
            curvature = before - 2.0 * here + after
            if curvature < -1e-6:
                vertex = 0.5 * (before - after) / curvature
                # Half a pixel's diagonal: an edge farther away belongs to another pixel.
                shift = min(max(vertex * (dx * ux + dy * uy), -0.71), 0.71)
        edges[i, 0], edges[i, 1] = x + shift * ux, y + shift * uy
        directions[i, 0], directions[i, 1] = ux, uy
