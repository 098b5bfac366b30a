"""Depths of followed points, smoothed over the surface: cameras beside one another know them worst."""

from __future__ import annotations

import numpy as np

from tracker.foundation.arrays import Array, Mask
from tracker.points.strain.gauges import Near

_LEAST = 10
"""Points around from which a curved surface is told: six numbers, and four that say that they fit."""

_WORSE = 2.0
"""A direction is known worst if its standard deviation is so many times that of the next one; else nothing is moved."""

_EDGE_ON = 0.1
"""Least spread of points across, seen along that direction, over that along: a surface seen edge on has no depth."""

_DAMPING = 1e-9
"""Of the normal equations, relative: points in a line have a surface, too."""


def smoothed(positions: Array, covariances: Array, around: Near) -> Array:
    """Points moved along the direction in which they are known worst, onto a curved surface through those around.

    Lateral places, which matching knows six times as well, stay. Points with too few around them stay as well.

    Args:
        positions: (N, 3) of a frame, metres; NaN where a point is not seen.
        covariances: (N, 3, 3) of them.
        around: the points around each in the frame of reference.
    """
    known: Mask = np.isfinite(positions[:, 0]) & np.isfinite(covariances[:, 0, 0])
    variances, axes = np.linalg.eigh(np.where(known[:, None, None], covariances, np.eye(3)))
    known &= variances[:, 2] > _WORSE**2 * variances[:, 1]
    there = around.there & np.isfinite(positions[:, 0])[around.members] & known[:, None]
    gone = np.where(there[..., None], positions[around.members] - positions[:, None], 0.0) @ axes
    size = np.sqrt((gone[..., :2] ** 2).sum(axis=(1, 2)) / np.maximum(there.sum(axis=1), 1)) + 1e-12
    u, v = (gone[..., :2] / size[:, None, None]).transpose(2, 0, 1)
    design = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=2) * there[..., None]
    normal = design.transpose(0, 2, 1) @ design
    normal += (_DAMPING * np.trace(normal, axis1=1, axis2=2) + 1e-12)[:, None, None] * np.eye(6)
    depth = np.linalg.solve(normal, design.transpose(0, 2, 1) @ gone[..., 2:])[:, 0, 0]
    spreads = np.linalg.eigvalsh(np.einsum("nki,nkj->nij", gone[..., :2], gone[..., :2]))
    told = (there.sum(axis=1) >= _LEAST) & (spreads[:, 0] > _EDGE_ON**2 * spreads[:, 1])
    depth = np.where(told, depth, 0.0)
    moved: Array = positions + axes[:, :, 2] * depth[:, None]
    return moved
