"""Scouts: some of the hidden points that no neighbour is near, looked for in a wide box by cross-correlation."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import cKDTree

from tracker.foundation.arrays import Array, Array32, Integers
from tracker.kernels.patches import key_side
from tracker.points.following.keys import Keys, Starts
from tracker.points.following.points import Points
from tracker.points.surfaces.matching import PatchImage

# So many hidden points are tried a frame, for speed; each with the motion of 24 seen ones, at least the six of an
# affinity.
_N_SCOUTS, _N_FAR, _LEAST_FAR = 200, 24, 6
# A hidden surface moves on unseen: what correlation may find it within.
_REACH_PX = 20
# A choice: a start only, matching decides.
_LEAST_CORRELATION = 0.7
_SPLINE = np.array([1, 4, 1], dtype=np.float64) / 6
"""Grey values of cubic B-spline coefficients at whole pixels."""


def chosen_scouts(points: Points, lonely: Integers) -> Integers:
    """Rows of no more than 200 hidden points, others in every frame, but the same when a run is resumed."""
    order = np.argsort(((points.ids[lonely] + 7919 * points.since[lonely]) * 2654435761) % 2**32, kind="stable")
    return lonely[order[:_N_SCOUTS]]


def far_expectation(points: Points, pixels: Array, rows: Integers, view: int) -> Starts:
    """Where the nearest points that are seen, however far, expect some points; their last places where none is seen.

    Args:
        points: all points.
        pixels: (V, N, 2) where they are now, px; NaN where not seen.
        rows: (M,) the points asked for.
        view: index of the view.
    """
    places = points.last_pixels[view, rows].copy()
    affine = points.affine[view, rows] @ points.key_from_birth[view, rows]
    born = points.birth_pixels[view]
    seen = np.flatnonzero(np.isfinite(pixels[view, :, 0]) & np.isfinite(born[:, 0]))
    asked = np.flatnonzero(np.isfinite(born[rows, 0]))
    if len(seen) < _LEAST_FAR or not len(asked):
        return Starts(places, affine)
    _, near = cKDTree(born[seen]).query(born[rows[asked]], k=min(_N_FAR, len(seen)))
    near = seen[np.asarray(near)]
    offset = born[near] - born[rows[asked]][:, None]
    design = np.concatenate([offset, np.ones((*offset.shape[:2], 1))], axis=2)
    normal = np.einsum("nki,nkj->nij", design, design)
    # Held towards a shift: far points on one side tell little of turns and stretches.
    normal += np.diag([1.0, 1.0, 0.0]) * (1.0 + np.trace(normal, axis1=1, axis2=2) / 3)[:, None, None] * 0.1
    moved = pixels[view][near] - offset
    solution = np.linalg.solve(normal, np.einsum("nki,nkj->nij", design, moved - moved.mean(axis=1, keepdims=True)))
    places[asked] = solution[:, 2] + moved.mean(axis=1)
    return Starts(places, affine)


def correlated_keys(keys: Keys, rows: Integers, image: PatchImage, start: Array, half: int) -> Array:
    """Places (M, 2) px of the best cross-correlation of key patches around each start; NaN where it is poor."""
    found = np.full(start.shape, np.nan)
    width, height = image.size
    grey = _grey(image.coefficients.reshape(height, width))
    side, wide = key_side(half), half + _REACH_PX
    for k in np.flatnonzero(keys.usable[rows] & np.isfinite(start).all(axis=1)).tolist():
        u, v = np.round(start[k]).astype(int)
        if not (wide <= u < width - wide and wide <= v < height - wide):
            continue
        patch = _grey(keys.patches[rows[k]].reshape(side, side))[2:-2, 2:-2]
        box = grey[v - wide : v + wide + 1, u - wide : u + wide + 1]
        correlation = cv2.matchTemplate(box, np.ascontiguousarray(patch), cv2.TM_CCOEFF_NORMED)
        row, column = divmod(int(correlation.argmax()), 2 * _REACH_PX + 1)
        if correlation[row, column] >= _LEAST_CORRELATION:
            found[k] = keys.offsets[rows[k]] + (u - _REACH_PX + column, v - _REACH_PX + row)
    return found


def _grey(coefficients: Array32) -> Array32:
    grey: Array32 = cv2.sepFilter2D(coefficients, -1, _SPLINE, _SPLINE, borderType=cv2.BORDER_REFLECT_101)
    return grey
