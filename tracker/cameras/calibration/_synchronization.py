"""Cameras that do not expose together: seen from a target's image, which then runs ahead or behind."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tracker.cameras.calibration._adjustment import Adjustment
from tracker.cameras.calibration._bundle import (
    Noise,
    Observations,
    State,
    adjust,
    noise_of,
    normal_equations,
    residuals,
)
from tracker.cameras.calibration._calibrated import Measure
from tracker.cameras.calibration._consensus import exchange_swapped_ends, with_consensus
from tracker.cameras.calibration._states import GROUPS
from tracker.foundation.arrays import Array
from tracker.foundation.errors import CalibrationError
from tracker.kernels.rows import BundleCameraRow, BundleUnknowns

_OFFSET = GROUPS["time_offset"][0]
# Free-running cameras are up to half a frame apart; by fewer than 20 moving points nothing is told: a choice.
_ALLOWED_FRAMES, _FEWEST_MOVING = 0.5, 20

NOTICED_FRAMES, NOTICED_SIGMAS = 0.03, 5.0
"""From such a time offset on it is determined with the rest, lest it spoils them."""


def time_offsets(state: State, observations: Observations, sigma_px: float) -> tuple[Array, Array]:
    """By how much each camera lags behind the others' median, frames, and the standard errors.

    The image of a target at the time of exposure is shifted by lag times velocity; the lag is adjusted along with the
    exterior orientations, camera constants and first radial distortions.

    Args:
        state: cameras and bars near the solution.
        observations: images with velocities; what does not move tells nothing.
        sigma_px: noise of an image coordinate.

    Returns:
        (V,) offsets and (V,) their standard errors, 0 of a view that is itself the median; NaN where nothing moves.
    """
    free = np.zeros((len(state.cameras), BundleUnknowns.N_UNKNOWNS), dtype=np.bool_)
    free[:, [*GROUPS["exterior"], *GROUPS["camera_constant"], 11]] = True
    free[1:, _OFFSET] = True
    speeds = np.linalg.norm(observations.velocities, axis=1)
    moving = np.bincount(observations.views, speeds > 1.0, minlength=len(free))
    if moving.min() < _FEWEST_MOVING:
        return np.full(len(free), np.nan), np.full(len(free), np.nan)
    for _ in range(3):
        scale = max(_noisiest(residuals(state, observations), observations, len(free)), sigma_px)
        observations, _ = exchange_swapped_ends(state, observations, scale)
        noise = Noise(scale, 3 * scale, used=speeds > 0)
        state, _ = adjust(state, observations, free, noise, tolerance=1e-3)
        state = with_consensus(state, observations, scale)
    errors = residuals(state, observations)
    scale = max(noise_of(errors), sigma_px)
    counted = observations.counted(speeds > 0, len(state.objects.points))
    equations = normal_equations(state, observations, Noise(scale, 3 * scale, used=speeds > 0).weights(errors), counted)
    columns = free.ravel()
    inverse = np.linalg.pinv(equations.normal[np.ix_(columns, columns)], hermitian=True, rcond=1e-13)
    covariance = np.zeros((len(columns), len(columns)))
    covariance[np.ix_(columns, columns)] = inverse
    return _beside_median(state.cameras[:, BundleCameraRow.DELAY], covariance)


def _beside_median(offsets: Array, covariance: Array) -> tuple[Array, Array]:
    """Offsets (V,) less their median, and the standard errors (V,) of that, from the covariance (17V, 17V).

    Those of the offsets themselves are against the first camera, whose own is 0 by definition.
    """
    order, n = np.argsort(offsets), len(offsets)
    less = np.eye(n) - np.eye(n)[order[[(n - 1) // 2, n // 2]]].mean(axis=0)
    own = covariance[_OFFSET :: BundleUnknowns.N_UNKNOWNS, _OFFSET :: BundleUnknowns.N_UNKNOWNS]
    return less @ offsets, np.sqrt(np.maximum(np.einsum("vi,ij,vj->v", less, own, less), 0.0))


def _noisiest(errors: Array, observations: Observations, n_views: int) -> float:
    """Noise of the view that fits worst, px: judged by the others', a late view would be all gross errors."""
    return max(noise_of(errors, observations.views == v) for v in range(n_views))


def check_synchronized(names: Sequence[str], offsets: Array, sigmas: Array) -> None:
    """Refuses views that are off by half a frame or more.

    Raises:
        CalibrationError: names the views and their offsets.
    """
    late = [v for v in range(len(names)) if abs(offsets[v]) > max(_ALLOWED_FRAMES, 4 * sigmas[v])]
    if (
        len(names) == 2
        and np.isfinite(offsets).all()
        and abs(offsets[1] - offsets[0]) > max(_ALLOWED_FRAMES, 4 * sigmas.sum())
    ):
        late = [1]
        offsets = offsets - offsets[0]
    if not late:
        return
    words = [f'"{names[v]}" is {abs(offsets[v]):.1f} frames {"late" if offsets[v] > 0 else "early"}' for v in late]
    table = ", ".join(f"{names[v]} = {-round(offsets[v])}" for v in late)
    raise CalibrationError(
        f"the views are not synchronized: {' and '.join(words)} compared with the others; start the cameras "
        f"together, or set offsets = {{ {table} }} in [views]"
    )


def lag_advice(adjustment: Adjustment) -> tuple[str, ...]:
    """Says which cameras expose noticeably, and beyond doubt, before or after the others."""
    return tuple(
        f"camera {name} exposes {abs(lag):.2f} frames {'after' if lag > 0 else 'before'} the others; the calibration "
        "allows for it, tracking cannot"
        for name, lag, sigma in _lags(adjustment)
        if abs(lag) - NOTICED_SIGMAS * sigma > NOTICED_FRAMES
    )


def lag_measures(adjustment: Adjustment) -> tuple[Measure, ...]:
    """The time offset of every camera where they were determined, else nothing."""
    return tuple(
        Measure(f"time offset of {name}", lag, "frames", "behind the others") for name, lag, _ in _lags(adjustment)
    )


def _lags(adjustment: Adjustment) -> list[tuple[str, float, float]]:
    """Name, time offset behind the others and its standard error, frames, of every camera; none if not determined."""
    if not adjustment.free[:, BundleUnknowns.DELAY].any():
        return []
    lags, sigmas = _beside_median(adjustment.state.cameras[:, BundleCameraRow.DELAY], adjustment.covariance)
    return list(zip(adjustment.names, lags.tolist(), sigmas.tolist(), strict=True))
