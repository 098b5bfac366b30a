"""The step of least quadratic cost within bounds, by an active set.

Block principal pivoting: all unknowns that break a condition change sides at once, and one at a time as soon as that
does not make them fewer (Judice & Pires 1994, for bounds on both sides). A step costs a few Cholesky decompositions;
bounded least squares by singular values took a quarter of a fit.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from tracker.foundation.arrays import Array

_PATIENCE = 10
"""Exchanges of all unknowns at once that may fail to lessen the broken conditions, before one at a time is exchanged,
which ends for certain (Judice & Pires: 10)."""


def bounded_step(matrix: Array, vector: Array, lower: Array, upper: Array) -> Array:
    """The minimum of ``x^T A x / 2 + b^T x`` with ``lower <= x <= upper``.

    Args:
        matrix: (n, n) symmetric and positive definite.
        vector: (n,)
        lower: (n,) bounds, perhaps infinite.
        upper: (n,) above the lower ones.

    Returns:
        (n,)
    """
    scale = 1 / np.sqrt(np.diag(matrix))
    matrix, vector, room = matrix * np.outer(scale, scale), vector * scale, (lower, upper)
    lower, upper = lower / scale, upper / scale
    side, fewest, left = np.zeros(len(vector), dtype=np.int8), len(vector) + 1, _PATIENCE
    while True:
        x = np.where(side > 0, upper, np.where(side < 0, lower, 0.0))
        free = side == 0
        if free.any():
            pull = vector[free] + matrix[np.ix_(free, ~free)] @ x[~free]
            x[free] = -cho_solve(cho_factor(matrix[np.ix_(free, free)]), pull)
        slope = matrix @ x + vector
        slack = _ROUNDING * (1 + np.abs(vector))
        wanted = np.where(free & (x > upper), 1, np.where(free & (x < lower), -1, side))
        wanted = np.where(~free & (side * slope > slack), 0, wanted).astype(np.int8)
        broken = np.flatnonzero(wanted != side)
        if not len(broken):
            return np.asarray(np.clip(x * scale, *room), dtype=np.float64)
        if len(broken) < fewest:
            fewest, left = len(broken), _PATIENCE
        else:
            left -= 1
        changed = broken if left > 0 else broken[-1:]
        side[changed] = wanted[changed]


_ROUNDING = 1e-12
"""Of a slope: below it an unknown at its bound may stay there."""
