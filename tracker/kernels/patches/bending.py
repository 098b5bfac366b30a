"""How far the mean of a followed patch lies from its centre, from the affine terms of its neighbours."""

from __future__ import annotations

import numpy as np

import tracker._native as native
from tracker.foundation.arrays import Array, Integers, Mask

LEAST_NEIGHBOURS = 6
"""Twice the unknowns of a plane through their differences."""

LARGEST_PX = 0.5
"""A larger correction is no curvature but a wrong neighbour."""

NO_SPREAD_PX2 = 1.0
"""Regularizes neighbours that lie at one place."""

NO_SHIFT_PX2 = 1e-12
"""Keeps 0 / 0 away."""


def bending_shifts(offsets: Array, rows: Integers, affine: Array, known: Mask, half: int) -> Array:
    """Shift of each patch's mean against its centre (N, 2) px; 0 where neighbours cannot tell.

    By Taylor's theorem it is ``(s_xx + s_yy) m / 2`` with m the mean square of a pixel's offset along an axis; the
    second derivatives are the slopes of the affine terms over the neighbours. Each shift is multiplied by the Wiener
    weight ``|mean s|^2 / mean |s|^2`` over the point and its neighbours.

    Args:
        offsets: (N, K, 2) of the neighbours from the points at birth, px.
        rows: (N, K) rows of the neighbours, -1 for none.
        affine: (N, 2, 2) from birth to now.
        known: (N,) points whose affine transformations are those of the present frame.
        half: the patch has 2 half + 1 pixels a side.
    """
    shifts = np.empty((len(rows), 2))
    native.bending_shifts(np.ascontiguousarray(offsets), np.ascontiguousarray(rows), affine, known, half, shifts)
    return shifts
