"""Where neighbours expect a point: a local affine map of the image since the point's birth."""

from __future__ import annotations

import numpy as np

from tracker.foundation.arrays import Array, Integers
from tracker.points.following.keys import Starts
from tracker.points.following.points import Points

LEAST = 6
"""An affinity has six unknowns in two coordinates: three points; twice as many, so that a wrong one shows."""

# Regularizes an affinity over neighbours that lie within some pixels; neighbours at 8 px count half.
_STIFFNESS_PX2, _NEAR_PX = 1.0, 8.0


def expected(points: Points, pixels: Array, which: Integers, view: int) -> Starts:
    """Where living neighbours expect M points, and how patches of the points' births look there.

    Least squares of ``c + F o`` for the neighbours' offsets o at the point's birth, with F held towards the unit matrix
    by one pixel squared, so that neighbours in a line do not turn the map over; near neighbours count more.

    Args:
        points: all N points.
        pixels: (V, N, 2) where they are now, px; NaN where not seen.
        which: (M,) rows of the points asked for.
        view: index of the view.

    Returns:
        Places and affine transformations from the birth; NaN where fewer than six neighbours are seen.
    """
    rows = points.rows_of(points.neighbours[which])
    at_birth = points.neighbour_pixels[view, which] - points.birth_pixels[view, which][:, None]
    now = pixels[view][np.maximum(rows, 0)]
    usable = (rows >= 0) & np.isfinite(now).all(axis=2) & np.isfinite(at_birth).all(axis=2)
    o = np.where(usable[..., None], at_birth, 0.0)
    weight = usable / (1.0 + (o**2).sum(axis=2) / _NEAR_PX**2)
    design = np.concatenate([o, np.ones((*o.shape[:2], 1))], axis=2)
    moved = np.where(usable[..., None], now, 0.0) - o
    normal = np.einsum("nki,nkj,nk->nij", design, design, weight)
    normal += np.diag([_STIFFNESS_PX2, _STIFFNESS_PX2, 1e-6])
    right = np.einsum("nki,nkj,nk->nij", design, moved, weight)
    solution = np.linalg.solve(normal, right)
    enough = usable.sum(axis=1) >= LEAST
    pixels = np.where(enough[:, None], solution[:, 2], np.nan)
    return Starts(pixels, np.swapaxes(solution[:, :2], 1, 2) + np.eye(2))
