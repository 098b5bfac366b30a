"""Wrenches on the ends of a kinematic chain, and what they are to the parameters that move those ends.

A point's image moves along a direction by ``g . (v + w x X)`` for each twist (v, w): the product of the twist with one
wrench (g, X x g). Wrenches are summed for each end of the chain first (6 x 6), and multiplied with the twists once.
"""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Mask
from tracker.kernels.compilation import compiled


@compiled
def add_wrench(
    point: tuple[float, float, float],
    gradient: tuple[float, float, float],
    residual: float,
    weight: float,
    wrenches: Array,
    pulls: Array,
) -> None:
    """Adds one residual to the sums of the end that its point hangs on.

    Args:
        point: X in the world, metres.
        gradient: g, the derivative of the residual by the point, px per metre.
        residual: px.
        weight: of its square.
        wrenches: (6, 6) sum of w g g^T over wrenches g, added to.
        pulls: (6,) sum of w r g, added to.
    """
    x, y, z = point
    gx, gy, gz = gradient
    wrench = (gx, gy, gz, y * gz - z * gy, z * gx - x * gz, x * gy - y * gx)
    for i in range(6):
        pulls[i] += weight * residual * wrench[i]
        for j in range(6):
            wrenches[i, j] += weight * wrench[i] * wrench[j]


@compiled
def chained(wrenches: Array, pulls: Array, used: Mask, twists: Array, moves: Mask) -> tuple[Array, Array]:
    """The normal equations of the parameters that move the ends.

    Args:
        wrenches: (dof + 1, 6, 6) of each end.
        pulls: (dof + 1, 6) likewise.
        used: (dof + 1,) ends that anything hangs on.
        twists: (dof, 6) spatial twists of the parameters.
        moves: (dof, dof + 1) from `BodyModel.moves`.

    Returns:
        J^T W J (dof, dof) and J^T W r (dof,).
    """
    dof = len(twists)
    matrix, vector = np.zeros((dof, dof)), np.zeros(dof)
    for end in range(dof):
        if used[end]:
            _add_end(wrenches[end], pulls[end], twists, moves[:, end], matrix, vector)
    return matrix, vector


@compiled
def _add_end(wrenches: Array, pulls: Array, twists: Array, chain: Mask, matrix: Array, vector: Array) -> None:
    """Adds the summed wrenches of what hangs on one parameter to the equations of all that move it."""
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
