"""Normal equations of a linearized least squares problem in a pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tracker.foundation.arrays import Array


@dataclass(frozen=True)
class Equations:
    """J^T W J dq = -J^T W r, with what is needed to judge the variance; several kinds of evidence add up."""

    matrix: Array
    """(dof, dof) J^T W J."""

    vector: Array
    """(dof,) J^T W r."""

    squares: float
    """Sum of w r^2, px^2."""

    total: float
    """Sum of w: the number of independent observations."""

    @staticmethod
    def of(residual: Array, jacobian: Array, weights: Array) -> Equations:
        """The equations of residuals (N,) px with Jacobian (N, dof) and weights (N,)."""
        weighted = weights[:, None] * jacobian
        squares = float((weights * residual**2).sum())
        return Equations(jacobian.T @ weighted, weighted.T @ residual, squares, float(weights.sum()))

    def pulled(self, weights: Array, offsets: Array) -> Equations:
        """The equations with a pull on each parameter (dof,), by its offset (dof,) from where it is drawn to.

        They say no more of the variance of a residual: a pull is no observation.
        """
        matrix = self.matrix.copy()
        matrix[np.diag_indices(len(weights))] += weights
        return replace(self, matrix=matrix, vector=self.vector + weights * offsets)

    @staticmethod
    def nothing(dof: int) -> Equations:
        """Equations that say nothing."""
        return Equations(np.zeros((dof, dof)), np.zeros(dof), 0.0, 0.0)


def combined(equations: Sequence[Equations], weights: Sequence[float]) -> Equations:
    """The sum of equations of the same pose, each times its weight; at least one."""
    weight, first = weights[0], equations[0]
    matrix, vector = weight * first.matrix, weight * first.vector
    squares, total = weight * first.squares, weight * first.total
    for weight, one in zip(weights[1:], equations[1:], strict=True):
        matrix += weight * one.matrix
        vector += weight * one.vector
        squares += weight * one.squares
        total += weight * one.total
    return Equations(matrix, vector, squares, total)
