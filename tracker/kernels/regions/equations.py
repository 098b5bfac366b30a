"""Normal equations of contour shifts."""

from __future__ import annotations

import numpy as np

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Integers, Mask
from tracker.kernels.regions.lines import Samples


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

    By wrenches, see native/body/wrenches.hpp; g is the derivative of the projection along the image normal.

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
    matrix, vector = np.empty((len(twists), len(twists))), np.empty(len(twists))
    sums = native.shift_equations(shifts, samples, ends, cameras, twists, moves, px_per_observation, matrix, vector)
    return matrix, vector, *sums
