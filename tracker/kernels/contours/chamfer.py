"""Directed chamfer distances between model contours and scene edges, batched over poses."""

from __future__ import annotations

from typing import Any

import numpy as np

from tracker.arrays import Array, Array32, Integers
from tracker.kernels.compilation import compiled
from tracker.kernels.rows import region


@compiled
def chamfer_lookup(flat: Array32, regions: Integers, v: int, x: float, y: float, outside: float) -> float:
    """Chamfer image of view v at a pixel position, bilinear; `outside` beyond its region.

    Args:
        flat, regions: chamfer images from `Observation.packed`.
        v: view.
        x, y: position in the whole image, px.
        outside: value beyond the region, px.
    """
    start, width, height = regions[v, region.START], regions[v, region.WIDTH], regions[v, region.HEIGHT]
    u, w = x - regions[v, region.LEFT], y - regions[v, region.TOP]
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


@compiled
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


@compiled(fastmath={"nnan", "ninf", "nsz", "contract"})
def _nearest_squared(xs: Array32, ys: Array32, n: int, four: tuple[Any, ...], best: Array32) -> None:
    """Lowers best[i] to the squared distance of point i to the nearest of four others; eight points at a time."""
    x0, y0, x1, y1, x2, y2, x3, y3 = four
    for i in range(n):
        x, y = xs[i], ys[i]
        a = min((x - x0) * (x - x0) + (y - y0) * (y - y0), (x - x1) * (x - x1) + (y - y1) * (y - y1))
        b = min((x - x2) * (x - x2) + (y - y2) * (y - y2), (x - x3) * (x - x3) + (y - y3) * (y - y3))
        best[i] = min(best[i], min(a, b))


Matching = tuple[Array32, Array32, Array32, Array32, Array32]
"""Positions and shares of a view's scene points, and shares and distances of whichever points are in work."""


@compiled
def matching_workspace(n_scene: int, n_samples: int) -> Matching:
    """What `directed_pair` writes to on its way; separate arrays, so that the compiler need not fear overlaps."""
    most = max(n_scene, n_samples) + 4
    return (
        np.zeros(n_scene, dtype=np.float32),
        np.zeros(n_scene, dtype=np.float32),
        np.zeros(n_scene, dtype=np.float32),
        np.empty(most, dtype=np.float32),
        np.empty(most, dtype=np.float32),
    )


@compiled
def directed_pair(
    samples: Array32,
    n_samples: int,
    flat: Array32,
    regions: Integers,
    v: int,
    scene: Array32,
    part: tuple[int, int],
    rule: tuple[float, bool],
    work: Matching,
) -> tuple[float, float]:
    """Normalized directed chamfer distances of one pose in one view: model to scene, scene to model, px.

    Args:
        samples: (M, 5 or more) pixel, image normal, contour length; those of length 0 are not matched, and those
            where the chamfer image is negative, for something hides them, are not measured.
        n_samples: valid ones.
        flat, regions: chamfer images, from `Observation.packed`.
        v: the view.
        scene: (S, 5) scene points of all views.
        part: first of the view's points and the one after its last.
        rule: distance theta at which a point is an outlier, px; whether it is rejected or else clamped.
        work: from `matching_workspace`.
    """
    theta, reject = rule
    start, n_scene = part[0], part[1] - part[0]
    xs, ys, scene_shares, shares, distances = work
    far = np.float32(1e6 if reject else theta + 1.0)
    n = 0
    for m in range(n_samples):
        if samples[m, 4] > 0.0:
            distances[n] = chamfer_lookup(flat, regions, v, samples[m, 0], samples[m, 1], theta + 1.0)
            if distances[n] < 0.0:
                continue
            shares[n] = samples[m, 4]
            n += 1
    to_scene = robust_mean(distances, shares, n, theta, reject)
    for i in range(n_scene):
        xs[i], ys[i], scene_shares[i] = scene[start + i, 0], scene[start + i, 1], scene[start + i, 4]
        distances[i] = far * far
    nowhere = np.float32(1e7)
    a = b = c = d = e = f = nowhere
    waiting = 0
    for m in range(n_samples):
        if samples[m, 4] <= 0.0:
            continue
        x, y = samples[m, 0], samples[m, 1]
        if waiting == 3:
            _nearest_squared(xs, ys, n_scene, (a, b, c, d, e, f, x, y), distances)
            a = b = c = d = e = f = nowhere
            waiting = 0
            continue
        a, b, c, d, e, f = c, d, e, f, x, y
        waiting += 1
    if waiting > 0:
        _nearest_squared(xs, ys, n_scene, (a, b, c, d, e, f, nowhere, nowhere), distances)
    for i in range(n_scene):
        distances[i] = np.sqrt(distances[i])
    return to_scene, robust_mean(distances, scene_shares, n_scene, theta, reject)


@compiled
def directed_distances(
    positions: Array32,
    counts: Integers,
    flat: Array32,
    regions: Integers,
    scene: Array32,
    first: Integers,
    theta: float,
    reject: bool,
) -> Array:
    """Normalized directed chamfer distances in both directions (paper, eqs. 1 and 2).

    Args:
        positions: (B, V, M, 5) model samples from `Contours`.
        counts: (B, V) valid ones.
        flat, regions, scene, first: the observation, from `Observation.packed`.
        theta: distance at which a point is an outlier, px.
        reject: reject outliers as the paper does, or else clamp them at theta.

    Returns:
        (B, V, 2) px: model to scene, scene to model; NaN for a missing view.
    """
    n_poses, n_views = counts.shape
    result = np.full((n_poses, n_views, 2), np.nan)
    work = matching_workspace(len(scene), positions.shape[2])
    for b in range(n_poses):
        for v in range(n_views):
            if regions[v, region.WIDTH] > 0:
                part, samples, n = (first[v], first[v + 1]), positions[b, v], counts[b, v]
                pair = directed_pair(samples, n, flat, regions, v, scene, part, (theta, reject), work)
                result[b, v, 0], result[b, v, 1] = pair
    return result
