"""Directed chamfer distances between model contours and scene edges, batched over poses."""

from __future__ import annotations

import numpy as np

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Integers


def chamfer_lookup(flat: Array32, regions: Integers, v: int, x: float, y: float, outside: float) -> float:
    """Chamfer image of view v at a pixel position, bilinear; `outside` beyond its region.

    Args:
        flat, regions: chamfer images from `Observation.packed`.
        v: view.
        x, y: position in the whole image, px.
        outside: value beyond the region, px.
    """
    return native.chamfer_lookup(flat, regions, v, x, y, outside)


def robust_mean(distances: Array32, weights: Array32, n: int, theta: float, reject: bool) -> float:
    """Normalized directed distance of n points (paper, eq. 2) with outliers clamped or rejected.

    Rejection follows the paper, section 4.1: points above theta first, then points above mean + 2 sigma of the
    rest. A set of which nothing is left, or an empty one, is at distance theta.
    """
    return native.robust_mean(distances, weights, n, theta, reject)


Matching = tuple[Array32, Array32, Array32, Array32, Array32]
"""Positions and shares of a view's scene points, and shares and distances of whichever points are in work."""


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
    distances = np.full((*counts.shape, 2), np.nan)
    native.directed_distances(positions, counts, flat, regions, scene, first, theta, reject, distances)
    return distances
