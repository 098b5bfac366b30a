"""How far attached points are from where a frame shows them, linearized at a pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.foundation.arrays import Array, Integers, Mask


@dataclass(frozen=True)
class Residuals:
    """N points where their part carries them less where they are seen, in D axes of image or space, px."""

    residual: Array
    """(N, D) px; 0 in the third axis of an image."""

    jacobian: Array
    """(N, D, dof) px per rad or metre."""

    covariance: Array
    """(N, D, D) of the residual, px^2; 1 in the third axis of an image."""

    n_axes: Integers
    """(N,) axes that count."""

    seen: Mask
    """(N,) whether the surface there faces the camera."""

    @property
    def variance(self) -> Array:
        """(N,) mean over the axes that count, px^2."""
        diagonals = np.diagonal(self.covariance, axis1=1, axis2=2)
        counts = np.arange(diagonals.shape[1]) < self.n_axes[:, None]
        variance: Array = np.where(counts, diagonals, 0.0).sum(axis=1) / self.n_axes
        return variance

    def beyond(self, sigmas: float) -> Mask:
        """(N,) points farther off than so many standard deviations, or on the far side of their part."""
        solved = np.linalg.solve(self.covariance, self.residual[..., None])[..., 0]
        squares = (self.residual * solved).sum(axis=1) / self.n_axes
        off: Mask = (squares > sigmas**2) | ~self.seen
        return off

    def along(self, directions: Array) -> Residuals:
        """Their components along directions (N, D); weak where a direction is short."""
        length = np.linalg.norm(directions, axis=1)
        unit = directions / np.maximum(length, 1e-9)[:, None]
        weak = np.maximum(length, 1e-3)[:, None, None]
        return Residuals(
            (self.residual * unit).sum(axis=1, keepdims=True),
            np.einsum("ni,nij->nj", unit, self.jacobian)[:, None],
            np.einsum("ni,nij,nj->n", unit, self.covariance, unit)[:, None, None] / weak**2,
            np.ones_like(self.n_axes),
            self.seen,
        )
