"""Where followed points lead the nodes of a contour: by the motion of those around each node."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import cKDTree

from tracker.foundation.arrays import Array, Integers, Mask

# Points that lead a node, and the least of them: three fix an affinity, twice as many show a wrong one.
_MOST, _LEAST = 12, 6
# Points at this distance count half; holds an affinity of near points towards a shift: both are choices.
_NEAR_PX, _STIFFNESS_PX2 = 10.0, 50.0
# Points that move otherwise than the median by three times the usual, and this, are of another surface.
_TIMES, _APART_PX = 3.0, 0.5


def led_nodes(
    places: Array, closed: bool, moved: tuple[Array, Array], reach_px: float, motion: Array
) -> tuple[Array, Integers]:
    """Carries the nodes of a contour along.

    A closed contour is led by points within it, which are of the same limb, wherever six of them are near.

    Args:
        places: (N, 2) nodes, px.
        closed: whether the contour is closed.
        moved: (M, 2) px of followed points in the same frame and in the next; NaN where not seen.
        reach_px: points farther from a node do not lead it.
        motion: (N, 2) of the nodes in the frame before, for those that no point leads.

    Returns:
        Where they are expected in the next frame (N, 2), and how many points led each one (N,).
    """
    known = np.isfinite(moved[0]).all(axis=1) & np.isfinite(moved[1]).all(axis=1)
    before, now = moved[0][known], moved[1][known]
    shifts, n_leading = np.full_like(places, np.nan), np.zeros(len(places), dtype=np.int64)
    if closed and len(before):
        own = inside(before, places)
        _lead(places, (before[own], now[own]), reach_px, shifts, n_leading)
    _lead(places, (before, now), reach_px, shifts, n_leading)
    return places + np.where(n_leading[:, None] > 0, shifts, motion), n_leading


def inside(points: Array, contour: Array) -> Mask:
    """(M,) points (M, 2) within a closed contour (N, 2), px."""
    low = np.floor(contour.min(axis=0)) - 1
    width, height = (contour.max(axis=0) - low + 3).astype(int)
    mask = np.zeros((height, width), dtype=np.uint8)
    cv2.fillPoly(mask, [np.round(contour - low).astype(np.int32)], 1)
    # points that the view does not show may be projected anywhere, and the frame of the mask is empty
    columns, rows = np.round(np.clip(points - low, 0, (width - 1, height - 1))).astype(int).T
    own: Mask = mask[rows, columns] > 0
    return own


def _lead(places: Array, moved: tuple[Array, Array], reach_px: float, shifts: Array, n_leading: Integers) -> None:
    """Fills the shifts of the nodes that have none yet and enough of these points around them."""
    before, now = moved
    free = np.flatnonzero(n_leading == 0)
    if len(before) < _LEAST or not len(free):
        return
    gaps, near = cKDTree(before).query(places[free], k=min(_MOST, len(before)), distance_upper_bound=reach_px)
    for row, distances, chosen in zip(free, np.asarray(gaps), np.asarray(near), strict=True):
        own = chosen[np.isfinite(distances)]
        if len(own) >= _LEAST:
            shifts[row], n_leading[row] = _shift(before[own] - places[row], now[own] - before[own])


def _shift(offsets: Array, moved: Array) -> tuple[Array, int]:
    """Shift (2,) of the origin by an affinity of points at offsets (K, 2), after those that move otherwise are out."""
    gaps = np.linalg.norm(moved - np.median(moved, axis=0), axis=1)
    alike = gaps <= _TIMES * np.median(gaps) + _APART_PX
    o, m = offsets[alike], moved[alike]
    weight = 1.0 / (1.0 + (o**2).sum(axis=1) / _NEAR_PX**2)
    design = np.concatenate([o, np.ones((len(o), 1))], axis=1)
    mean = weight @ m / weight.sum()
    normal = (design * weight[:, None]).T @ design + np.diag([_STIFFNESS_PX2, _STIFFNESS_PX2, 0.0])
    solution = np.linalg.solve(normal, (design * weight[:, None]).T @ (m - mean))
    return solution[2] + mean, len(o)
