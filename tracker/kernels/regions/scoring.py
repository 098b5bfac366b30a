"""Poses synthesized and compared with the colours of the images in one go: no contour is written to memory.

In a decomposed search most parts of the body stand still. They are traced, and their lines read, once for all poses;
of each pose only the moving parts are, and it is asked which lines of the others they cover or lie beside.
"""

from __future__ import annotations

import numpy as np

import tracker._native as native
from tracker.foundation.arrays import Array, Array32
from tracker.kernels.regions.lines import Lines


def score_regions(
    placements: Array,
    shapes: Array,
    grids: Array32,
    planes: Array32,
    layout: tuple[int, int],
    bounds: Array,
    cameras: Array,
    sizes: Array,
    spacing: tuple[float, float],
    lines: Lines,
) -> Array:
    """Misfits of many poses; the twin is `trace_contours`, `parts_beside` and `score_lines`.

    Args:
        placements, shapes, grids, planes, layout, bounds, cameras, sizes, spacing: see `trace_contours`.
        lines: what they are compared with.

    Returns:
        (B, V, P, 3) see `score_lines`.
    """
    misfits = np.zeros((len(placements), len(cameras), len(shapes), 3))
    body = shapes, grids, planes, layout, bounds
    native.score_regions(placements, *body, cameras, sizes, spacing, lines, misfits)
    return misfits
