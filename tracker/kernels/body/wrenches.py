"""Wrenches on the ends of a kinematic chain, and what they are to the parameters that move those ends."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Mask
from tracker.kernels.compilation import compiled


@compiled
def add_end(wrenches: Array, pulls: Array, twists: Array, chain: Mask, matrix: Array, vector: Array) -> None:
    """Adds the summed wrenches of what hangs on one parameter to the equations of all that move it.

    Args:
        wrenches: (6, 6) sum of w g g^T over the wrenches g.
        pulls: (6,) sum of w r g.
        twists: (dof, 6) spatial twists of the parameters.
        chain: (dof,) parameters that move the end.
        matrix, vector: (dof, dof) and (dof,), added to.
    """
    half = np.zeros(6)
    for d in range(len(twists)):
        if not chain[d]:
            continue
        for i in range(6):
            half[i] = 0.0
            vector[d] += twists[d, i] * pulls[i]
            for j in range(6):
                half[i] += wrenches[i, j] * twists[d, j]
        for e in range(len(twists)):
            if chain[e]:
                for i in range(6):
                    matrix[e, d] += twists[e, i] * half[i]
