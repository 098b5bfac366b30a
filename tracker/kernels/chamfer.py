"""Directed chamfer distances between model contours and scene edges, batched over poses."""

from __future__ import annotations

import numpy as np
from numba import njit

from tracker.arrays import Array, Array32, Integers


@njit(cache=True, nogil=True, error_model="numpy")
def chamfer_lookup(flat: Array32, layout: Integers, v: int, x: float, y: float, outside: float) -> float:
    """Chamfer image of view v at a pixel position, bilinear; `outside` beyond its region.

    Args:
        flat, layout: chamfer images from `Observation.packed`.
        v: view.
        x, y: position in the whole image, px.
        outside: value beyond the region, px.
    """
    start, width, height = layout[v, 0], layout[v, 3], layout[v, 4]
    u, w = x - layout[v, 1], y - layout[v, 2]
    if u < 0.0 or w < 0.0 or u > width - 1 or w > height - 1:
        return outside
    column, row = min(int(u), width - 2), min(int(w), height - 2)
    if column < 0 or row < 0:
        return outside
    a, b = u - column, w - row
    at = start + row * width + column
    upper = (1.0 - a) * flat[at] + a * flat[at + 1]
    lower = (1.0 - a) * flat[at + width] + a * flat[at + width + 1]
    return (1.0 - b) * upper + b * lower


@njit(cache=True, nogil=True, error_model="numpy")
def robust_mean(distances: Array32, weights: Array32, n: int, theta: float, reject: bool) -> float:
    """Normalized directed distance of n points (paper, eq. 2) with outliers clamped or rejected.

    Rejection follows the paper, section 4.1: points above theta first, then points above mean + 2 sigma of the
    rest. A set of which nothing is left, or an empty one, is at distance theta.
    """
    total = mean = 0.0
    for i in range(n):
        if reject and distances[i] > theta:
            continue
        total += weights[i]
        mean += weights[i] * min(distances[i], theta)
    if total <= 0.0:
        return theta
    mean /= total
    if not reject:
        return mean
    variance = 0.0
    for i in range(n):
        if distances[i] <= theta:
            variance += weights[i] * (distances[i] - mean) ** 2
    limit = mean + 2.0 * np.sqrt(variance / total)
    total = kept = 0.0
    for i in range(n):
        if distances[i] <= theta and distances[i] <= limit:
            total += weights[i]
            kept += weights[i] * distances[i]
    return kept / total if total > 0.0 else theta


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "ninf", "nsz"})
def nearest_squared(columns: Array32, x: float, y: float, best: Array32, n: int) -> None:
    """Lowers best[i] to the squared distance of scene point i to (x, y); vectorizes over the scene points."""
    px, py = np.float32(x), np.float32(y)
    for i in range(n):
        dx, dy = columns[0, i] - px, columns[1, i] - py
        best[i] = min(best[i], dx * dx + dy * dy)


@njit(cache=True, nogil=True, error_model="numpy")
def directed_distances(
    positions: Array32,
    counts: Integers,
    flat: Array32,
    layout: Integers,
    scene: Array32,
    first: Integers,
    theta: float,
    reject: bool,
) -> Array:
    """Normalized directed chamfer distances in both directions (paper, eqs. 1 and 2).

    Args:
        positions: (B, V, M, 5) model samples from `Contours`.
        counts: (B, V) valid ones.
        flat, layout, scene, first: the observation, from `Observation.packed`.
        theta: distance at which a point is an outlier, px.
        reject: reject outliers as the paper does, or else clamp them at theta.

    Returns:
        (B, V, 2) px: model to scene, scene to model; NaN for a missing view.
    """
    n_poses, n_views = counts.shape
    result = np.zeros((n_poses, n_views, 2))
    most = 0
    for v in range(n_views):
        most = max(most, first[v + 1] - first[v])
    columns = np.zeros((2, most), dtype=np.float32)
    weights, best = np.zeros(most, dtype=np.float32), np.zeros(most, dtype=np.float32)
    distances = np.zeros(positions.shape[2], dtype=np.float32)
    shares = np.zeros(positions.shape[2], dtype=np.float32)
    for v in range(n_views):
        if layout[v, 3] == 0:
            result[:, v, :] = np.nan
            continue
        n_scene = first[v + 1] - first[v]
        for i in range(n_scene):
            columns[0, i], columns[1, i] = scene[first[v] + i, 0], scene[first[v] + i, 1]
            weights[i] = scene[first[v] + i, 4]
        for b in range(n_poses):
            best[:] = np.float32(theta * theta + 1.0) if not reject else np.float32(1e12)
            n = 0
            for m in range(counts[b, v]):
                if positions[b, v, m, 4] <= 0.0:
                    continue
                x, y = positions[b, v, m, 0], positions[b, v, m, 1]
                distances[n] = chamfer_lookup(flat, layout, v, x, y, theta + 1.0)
                shares[n] = positions[b, v, m, 4]
                nearest_squared(columns, x, y, best, n_scene)
                n += 1
            result[b, v, 0] = robust_mean(distances, shares, n, theta, reject)
            for i in range(n_scene):
                best[i] = np.sqrt(best[i])
            result[b, v, 1] = robust_mean(best, weights, n_scene, theta, reject)
    return result
