"""Normal equations of contour shifts."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Array32, Integers, Mask
from tracker.kernels.body.wrenches import add_wrench, chained
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

    By wrenches, see `tracker.kernels.body.wrenches`; g is the derivative of the projection along the image normal.

    Args:
        shifts: (V, M, 3) from `find_shifts`; a line counts by its inverse variance, px^-2, and its support.
        samples: contour samples.
        ends: (P,) last parameter that moves each part, -1 for the world; -2 for parts that do not count.
        cameras: (V, 29) from `Rig.packed`.
        twists: (dof, 6) spatial twists of the parameters.
        moves: (dof, dof + 1) from `BodyModel.moves`.
        px_per_observation: contour length that counts as one observation, px.

    Returns:
        J^T W J (dof, dof), J^T W r (dof,), sum of w r^2 and sum of w.
    """
    dof = len(twists)
    squares = total = 0.0
    wrenches, pulls = np.zeros((dof + 1, 6, 6)), np.zeros((dof + 1, 6))
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
            residual = -float(shifts[v, m, 0])
            used[end] = True
            add_wrench((x, y, z), (gx, gy, gz), residual, weight, wrenches[end], pulls[end])
            squares += weight * residual * residual
            total += weight
    matrix, vector = chained(wrenches, pulls, used, twists, moves)
    return matrix, vector, squares, total
