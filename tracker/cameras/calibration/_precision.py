"""How precisely cameras are determined: the covariance of their unknowns, under the datum, and its correlations."""

from __future__ import annotations

import numpy as np

from tracker.cameras.calibration._bundle import Observations, State, normal_equations, residuals
from tracker.cameras.calibration._correlated import scatter
from tracker.cameras.calibration._objects import Boards
from tracker.cameras.calibration._states import rigid_motions
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.errors import CalibrationError


def precision(
    state: State, observations: Observations, used: Mask, free: Mask, sigma_px: float
) -> tuple[Array, float, int]:
    """Covariance (17V, 17V) of the cameras scaled by s0, s0, and the redundancy."""
    objects = state.objects
    counted = observations.counted(used, len(objects.points))
    errors = residuals(state, observations)[used] / sigma_px
    conditions = objects.conditions(counted)[2]
    datum = 0 if objects.fixes_datum else 6
    redundancy = 2 * len(errors) + len(conditions) - int(free.sum()) + datum - objects.n_unknowns(counted)
    if redundancy < 1:
        raise CalibrationError(f"{2 * len(errors)} image coordinates are not enough for the unknowns: record more")
    s0 = float(np.sqrt((np.sum(errors**2) + conditions @ conditions) / redundancy))
    equations = normal_equations(state, observations, used / sigma_px**2, counted)
    chosen = free.ravel()
    covariance = np.zeros(equations.normal.shape)
    loose = None if objects.fixes_datum else rigid_motions(state.cameras)[chosen]
    covariance[np.ix_(chosen, chosen)] = s0**2 * _inverse(equations.normal[np.ix_(chosen, chosen)], loose)
    return covariance, s0, redundancy


def cluster_robust(
    covariance: Array, state: State, observations: Observations, weights: Array, free: Mask
) -> tuple[Array, float, float]:
    """Covariance with standard errors that the scatter of a board's positions bears out; see `_correlated`.

    Returns:
        Covariance (17V, 17V), by how much standard errors grew, and how bent the board is, metres.
    """
    chosen = free.ravel()
    if not isinstance(state.objects, Boards) or not chosen.any():
        return covariance, 1.0, 0.0
    loose = rigid_motions(state.cameras)[chosen]
    found = scatter(state, observations, weights, free, lambda normal: _inverse(normal, loose))
    before = np.diag(covariance)[chosen]
    grown = np.sqrt(np.maximum(np.diag(found.covariance) / np.maximum(before, 1e-300), 1.0))
    factors = np.ones(len(chosen))
    factors[chosen] = grown
    return factors[:, None] * covariance * factors, float(np.median(grown)), found.bent_m


def correlation(covariance: Array) -> Array:
    """(U, U) correlations of unknowns with a covariance (U, U); 0 of those held."""
    sigmas = np.sqrt(np.diag(covariance))
    scale = np.where(sigmas > 0, 1 / np.where(sigmas > 0, sigmas, 1.0), 0.0)
    normalized: Array = scale[:, None] * covariance * scale
    return normalized


def _inverse(normal: Array, loose: Array | None) -> Array:
    """Inverse of a normal matrix, under inner constraints on the motions that it leaves open."""
    scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = scale[:, None] * normal * scale
    n, n_loose = len(normal), 0 if loose is None else loose.shape[1]
    bordered = np.zeros((n + n_loose, n + n_loose))
    bordered[:n, :n] = scaled
    if loose is not None:
        # the condition is that of the unscaled unknowns: loose^T x = 0
        border = loose * scale[:, None]
        border /= np.linalg.norm(border, axis=0)
        bordered[:n, n:], bordered[n:, :n] = border, border.T
    try:
        inverse = np.linalg.inv(bordered)[:n, :n]
    except np.linalg.LinAlgError:
        inverse = np.linalg.pinv(bordered, hermitian=True)[:n, :n]
        np.fill_diagonal(inverse, np.maximum(np.diag(inverse), 1e6))
    result: Array = scale[:, None] * (inverse + inverse.T) / 2 * scale
    np.fill_diagonal(result, np.abs(np.diag(result)))
    return result
