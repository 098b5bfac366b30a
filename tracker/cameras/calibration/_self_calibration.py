"""The whole adjustment: gross errors found, precision told, and what cannot be determined named and held."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tracker.cameras.calibration._adjustment import Adjustment
from tracker.cameras.calibration._bundle import Noise, Observations, State, adjust, noise_of, residuals
from tracker.cameras.calibration._consensus import exchange_swapped_ends, with_consensus
from tracker.cameras.calibration._determinability import undetermined
from tracker.cameras.calibration._objects import Bars
from tracker.cameras.calibration._precision import cluster_robust, precision
from tracker.cameras.calibration._states import GROUPS, STATE_COLUMNS
from tracker.foundation.arrays import Mask
from tracker.foundation.errors import CalibrationError, nearest
from tracker.kernels.rows import BundleUnknowns

_REJECTED_AT = 4.0
"""A residual longer than so many standard deviations is a gross error; 3 of 10 000 right ones are."""


def chosen_unknowns(groups: Sequence[str], n_cameras: int) -> Mask:
    """(V, 17) unknowns of the named groups; time offsets are relative to the first camera.

    Raises:
        CalibrationError: there is no such group.
    """
    free = np.zeros((n_cameras, BundleUnknowns.N_UNKNOWNS), dtype=np.bool_)
    for group in ("exterior", *groups):
        if group not in GROUPS:
            raise CalibrationError(f'no group of parameters "{group}"; {nearest(group, GROUPS)}')
        free[:, GROUPS[group]] = True
    free[0, GROUPS["time_offset"]] = False
    return free


def self_calibrated(
    start: State,
    observations: Observations,
    wanted: Mask,
    sigma_px: float,
    views: Sequence[tuple[str, tuple[int, int]]],
) -> Adjustment:
    """Adjusts cameras and objects, without gross errors and without parameters that cannot be determined.

    Args:
        start: near the solution.
        observations: images of the objects' points.
        wanted: (V, 17) unknowns to determine if that can be done.
        sigma_px: a-priori standard deviation of an image coordinate.
        views: name and image size of each camera.

    Raises:
        CalibrationError: too few observations fit together.
    """
    names = tuple(name for name, _ in views)
    state, observations, exchanged = _robust(start, observations, wanted, sigma_px)
    state, used = _without_gross_errors(state, observations, wanted, sigma_px)
    _check_enough(observations, used, names)
    free, held = wanted.copy(), []
    while True:
        covariance, s0, redundancy = precision(state, observations, used, free, sigma_px)
        worst = undetermined(state, free, covariance, views)
        if worst is None:
            break
        (view, k), entry = worst
        free[view, k] = False
        held.append(entry)
        cameras = state.cameras.copy()
        column = STATE_COLUMNS[k]
        cameras[view, column] = start.cameras[view, column] if entry.at_start else 0.0
        state, _ = adjust(replace(state, cameras=cameras), observations, free, Noise(sigma_px, used=used))
    covariance, inflation, bent_m = cluster_robust(covariance, state, observations, used / sigma_px**2, free)
    errors = residuals(state, observations)
    errors[observations.counted(used, len(state.objects.points))[observations.points] == 0] = np.nan
    return Adjustment(
        names, tuple(size for _, size in views), state, observations, used, exchanged, errors,
        sigma_px, s0, redundancy, covariance, free, tuple(held), inflation, bent_m,
    )  # fmt: skip


def _robust(start: State, observations: Observations, free: Mask, sigma_px: float) -> tuple[State, Observations, Mask]:
    """Adjusts with gross errors weighed down, exchanging swapped ends on the way."""
    state, exchanged = start, np.zeros(len(observations), dtype=np.bool_)
    for _ in range(3):
        scale = max(noise_of(residuals(state, observations)), sigma_px)
        if isinstance(state.objects, Bars):
            state = with_consensus(state, observations, scale)
            observations, turned = exchange_swapped_ends(state, observations, scale)
            exchanged ^= turned
            state = with_consensus(state, observations, scale) if turned.any() else state
        state, _ = adjust(state, observations, free, Noise(sigma_px, 3 * scale), tolerance=1e-3)
    return state, observations, exchanged


def _without_gross_errors(state: State, observations: Observations, free: Mask, sigma_px: float) -> tuple[State, Mask]:
    """Least squares over the observations that are no gross errors."""
    used = np.zeros(len(observations), dtype=np.bool_)
    for _ in range(6):
        errors = residuals(state, observations)
        scale = max(noise_of(errors), sigma_px)
        before, used = used, np.asarray(np.einsum("ni,ni->n", errors, errors) < (_REJECTED_AT * scale) ** 2)
        used = _checkable(used, state, observations)
        if (used == before).all():
            break
        state, _ = adjust(state, observations, free, Noise(sigma_px, used=used), tolerance=1e-6)
    return state, used


def _checkable(used: Mask, state: State, observations: Observations) -> Mask:
    """Leaves out images that say nothing: they fit wherever their object is, and would pass for redundancy."""
    counted = observations.counted(used, len(state.objects.points))
    return used & state.objects.determined(counted)[observations.points]


def _check_enough(observations: Observations, used: Mask, names: tuple[str, ...]) -> None:
    for v, name in enumerate(names):
        mine = observations.views == v
        share = used[mine].mean() if mine.any() else 0.0
        if used[mine].sum() < 20 or share < 0.4:
            raise CalibrationError(
                f'camera "{name}": {int(used[mine].sum())} of {int(mine.sum())} images of targets fit the other '
                "cameras, expected at least 20 and 40 %: is it synchronized, is its focal length right to 10 %, and "
                "are its targets the ones meant?"
            )
