"""How much of a pose's contours lies on edges, and how much of the edges no contour explains."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Array32, Integers
from tracker.kernels.compilation import compiled
from tracker.kernels.rows import region, sample, scene_point


@compiled
def nearest_gap(flat: Array32, regions: Integers, v: int, x: float, y: float, outside: float) -> float:
    """Chamfer image of view v at the pixel nearest to a position; `outside` beyond its region.

    Args:
        flat, regions: chamfer images from `Observation.packed`.
        v: view.
        x, y: position in the whole image, px.
        outside: value beyond the region, px.
    """
    column, row = int(np.rint(x)) - regions[v, region.LEFT], int(np.rint(y)) - regions[v, region.TOP]
    if column < 0 or row < 0 or column >= regions[v, region.WIDTH] or row >= regions[v, region.HEIGHT]:
        return outside
    return float(flat[regions[v, region.START] + row * regions[v, region.WIDTH] + column])


@compiled
def edge_shares(
    positions: Array32,
    parts: Integers,
    counts: Integers,
    flat: Array32,
    regions: Integers,
    scene: Array32,
    first: Integers,
    reach: Array32,
    near_px: tuple[float, float],
    sums: Array,
) -> None:
    """Adds up over all views what the contours of one pose and the edges leave of each other.

    Args:
        positions: (V, M, 5) contour samples from `Contours`; those of length 0 explain edges and count as none, as
            do those where the chamfer image is negative, for something hides them.
        parts: (V, M) part of each.
        counts: (V,) valid ones.
        flat, regions, scene, first, reach: the observation, from `Observation.packed`.
        near_px: how close to an edge a sample counts as explained, and how far from all samples an edge as missed.
        sums: (4, V, P) output, px: visible contour; times its distance to the edges; explained; length of edges far
            from all samples, by the part of the nearest.
    """
    sums[:] = 0.0
    xs, ys = np.empty(parts.shape[1]), np.empty(parts.shape[1])
    for v in range(len(counts)):
        if regions[v, region.WIDTH] == 0:
            continue
        for m in range(counts[v]):
            xs[m], ys[m] = positions[v, m, sample.U], positions[v, m, sample.V]
            length, p = float(positions[v, m, sample.LENGTH]), parts[v, m]
            gap = nearest_gap(flat, regions, v, xs[m], ys[m], float(reach[v]))
            if gap < 0.0:
                continue
            sums[0, v, p] += length
            sums[1, v, p] += length * gap
            sums[2, v, p] += length if gap <= near_px[0] else 0.0
        for i in range(first[v], first[v + 1] if counts[v] > 0 else first[v]):
            x, y = float(scene[i, scene_point.X]), float(scene[i, scene_point.Y])
            least, nearest = np.inf, 0
            for m in range(counts[v]):
                square = (xs[m] - x) ** 2 + (ys[m] - y) ** 2
                if square < least:
                    least, nearest = square, m
            if np.sqrt(least) > near_px[1]:
                sums[3, v, parts[v, nearest]] += scene[i, scene_point.WEIGHT]
