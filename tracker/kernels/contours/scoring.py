"""Poses synthesized and compared with an observation in one go: no contour is written to memory.

In a decomposed search most parts of the body stand still. They are traced once for all its poses; of each only the
moving parts are traced, and tested for what they hide of the others. Parts that stand as in the pose before are not
even drawn again: side by side with other searches of the same limb half of the moving ones do.
"""

from __future__ import annotations

import numpy as np

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Integers, Mask
from tracker.kernels.rows import sample
from tracker.kernels.rows.workspace import ROW


def moving_parts(placements: Array) -> Mask:
    """Parts (P,) whose placements (B, P, 4, 4) are not the same in all poses; all of them where B is 0 or 1."""
    moving = np.zeros(placements.shape[1], dtype=np.bool_)
    native.moving_parts(placements, moving)
    return moving


def trace_still(
    placements: Array,
    still: Mask,
    shapes: Array,
    grids: Array32,
    planes: Array32,
    layout: tuple[int, int],
    bounds: Array,
    cameras: Array,
    sizes: Array,
    spacing: tuple[float, float],
) -> tuple[Array32, Integers]:
    """Contour samples of the parts that stand still in a search, for `score_poses`; nothing else covers them here.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres; the first one counts.
        still: (P,) the parts.
        shapes, grids, planes, layout, bounds, cameras, sizes, spacing: see `trace_contours`.

    Returns:
        (V, ROW, 13) samples, see `trace_view`; (V,) their numbers.
    """
    samples = np.zeros((len(cameras), ROW, sample.N_COLUMNS), dtype=np.float32)
    counts = np.zeros(len(cameras), dtype=np.int64)
    if still.any():
        body = shapes, grids, planes, layout, bounds
        native.trace_still(placements, still, *body, cameras, sizes, spacing, samples, counts)
    return samples, counts


def score_poses(
    placements: Array,
    shapes: Array,
    grids: Array32,
    planes: Array32,
    layout: tuple[int, int],
    bounds: Array,
    cameras: Array,
    sizes: Array,
    spacing: tuple[float, float],
    flat: Array32,
    regions: Integers,
    scene: Array32,
    first: Integers,
    rule: tuple[float, bool],
    moving: Mask,
    standing: tuple[Array32, Integers],
) -> Array:
    """Directed chamfer distances of many poses; the twin is `trace_contours` and `directed_distances`.

    Args:
        placements, shapes, grids, planes, layout, bounds, cameras, sizes, spacing: see `trace_contours`.
        flat, regions, scene, first: the observation, from `Observation.packed`.
        rule: distance at which a point is an outlier, px; reject outliers as the paper does, or else clamp them.
        moving: (P,) parts that do not stand still, at least those of `moving_parts`.
        standing: of the other parts, from `trace_still`.

    Returns:
        (B, V, 2) px: model to scene, scene to model; NaN for a missing view.
    """
    body, edges = (shapes, grids, planes, layout, bounds), (flat, regions, scene, first)
    distances = np.full((len(placements), len(cameras), 2), np.nan)
    native.score_poses(placements, *body, cameras, sizes, spacing, *edges, rule, moving, *standing, distances)
    return distances
