"""Normal equations of contour shifts."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Array32, Integers, Mask
from tracker.kernels.body.wrenches import add_end
from tracker.kernels.compilation import compiled
from tracker.kernels.projection import project_along
from tracker.kernels.regions.lines import Samples
from tracker.kernels.rows import sample


@compiled
def shift_equations(
    shifts: Array32,
    samples: Samples,
    ends: Integers,
    cameras: Array,
    twists: Array,
    moves: Mask,
    px_per_observation: float,
) -> tuple[Array, Array, float, float]:
    """Normal equations that move every sample along its normal by its shift.

    A sample's image moves along its normal by ``n . J_projection (v + w x X)`` for each twist (v, w): the product of
    the twist with one wrench (g, X x g). Wrenches are summed for each end of the chain first (6 x 6), and multiplied
    with the twists once.

    Args:
        shifts: (V, M, 3) from `find_shifts`; a line counts by its inverse variance, px^-2, and its support.
        samples: contour samples.
        ends: (P,) last parameter that moves each part, -1 for the world; -2 for parts that do not count.
        cameras: (V, 25) from `Rig.packed`.
        twists: (dof, 6) spatial twists of the parameters.
        moves: (dof, dof + 1) from `BodyModel.moves`.
        px_per_observation: contour length that counts as one observation, px.

    Returns:
        J^T W J (dof, dof), J^T W r (dof,), sum of w r^2 and sum of w.
    """
    dof = len(twists)
    squares = total = 0.0
    matrices, vectors, wrench = np.zeros((dof + 1, 6, 6)), np.zeros((dof + 1, 6)), np.zeros(6)
    used = np.zeros(dof + 1, dtype=np.bool_)
    for v in range(len(samples.counts)):
        for m in range(samples.counts[v]):
            end = ends[samples.parts[v, m]]
            weight = samples.positions[v, m, sample.LENGTH] / px_per_observation * shifts[v, m, 1] * shifts[v, m, 2]
            if weight <= 0.0 or end < 0:
                continue
            x, y, z = float(samples.points[v, m, 0]), float(samples.points[v, m, 1]), float(samples.points[v, m, 2])
            normal = float(samples.positions[v, m, 2]), float(samples.positions[v, m, 3])
            _, _, gx, gy, gz = project_along(cameras, v, (x, y, z), normal)
            wrench[0], wrench[1], wrench[2] = gx, gy, gz
            wrench[3], wrench[4], wrench[5] = y * gz - z * gy, z * gx - x * gz, x * gy - y * gx
            residual = -float(shifts[v, m, 0])
            used[end] = True
            for i in range(6):
                vectors[end, i] += weight * residual * wrench[i]
                for j in range(6):
                    matrices[end, i, j] += weight * wrench[i] * wrench[j]
            squares += weight * residual * residual
            total += weight
    matrix, vector = np.zeros((dof, dof)), np.zeros(dof)
    for end in range(dof):
        if used[end]:
            add_end(matrices[end], vectors[end], twists, moves[:, end], matrix, vector)
    return matrix, vector, squares, total
