"""What is left of white image noise after smoothing, interpolation and differentiation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.foundation.arrays import Array


@dataclass(frozen=True)
class NoisePowers:
    """Powers of white noise of variance 1 in what a match compares."""

    residual: float
    """In the difference of a template at whole pixels and a search patch anywhere between pixels."""

    gradient_of_template: float
    """In a derivative of the template, at whole pixels, per px^2."""

    gradient_of_search: float
    """In a derivative of the search image, anywhere between pixels, per px^2."""


def gaussian_taps(sigma_px: float) -> Array:
    """Taps of the Gaussian that images are smoothed with, reaching four sigmas; one tap for no smoothing."""
    if sigma_px <= 0:
        return np.ones(1)
    reach = max(1, round(4 * sigma_px))
    taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma_px) ** 2)
    normalized: Array = taps / taps.sum()
    return normalized


def spline_taps(reach: int = 12) -> Array:
    """Taps that turn grey values into cubic B-spline coefficients.

    They are ``sqrt(3) z^|k|`` with z = sqrt(3) - 2 (Unser 1999), cut where they fall below the resolution of single
    precision: 31 of them with the smoothing cost a seventh of the recursive filter of scipy.
    """
    taps: Array = np.sqrt(3) * (np.sqrt(3) - 2) ** np.abs(np.arange(-reach, reach + 1))
    return taps


def noise_powers(sigma_px: float, n_frequencies: int = 256, n_fractions: int = 32) -> NoisePowers:
    """Integrates the squared responses of smoothing and cubic B-splines over frequencies and pixel fractions."""
    omega = 2 * np.pi * (np.arange(n_frequencies) + 0.5) / n_frequencies
    taps = gaussian_taps(sigma_px)
    reach = np.arange(len(taps)) - len(taps) // 2
    smoothing = (taps * np.cos(np.outer(omega, reach))).sum(axis=1)
    prefiltered = smoothing / ((2 + np.cos(omega)) / 3)
    fractions = np.arange(n_fractions) / n_fractions
    values = np.array([_power(prefiltered, omega, _weights(f)) for f in fractions])
    slopes = np.array([_power(prefiltered, omega, _slopes(f)) for f in fractions])
    return NoisePowers(
        residual=float(values[0] ** 2 + values.mean() ** 2),
        gradient_of_template=float(slopes[0] * values[0]),
        gradient_of_search=float(slopes.mean() * values.mean()),
    )


def _power(prefiltered: Array, omega: Array, weights: Array) -> float:
    response = np.abs(np.exp(1j * np.outer(omega, np.arange(-1, 3))) @ weights) * prefiltered
    return float((response**2).mean())


def _weights(f: float) -> Array:
    """The four cubic B-splines that reach a point a fraction beyond a pixel."""
    return np.array([(1 - f) ** 3, 4 - 6 * f**2 + 3 * f**3, 1 + 3 * f + 3 * f**2 - 3 * f**3, f**3]) / 6


def _slopes(f: float) -> Array:
    return np.array([-((1 - f) ** 2), 3 * f**2 - 4 * f, 1 + 2 * f - 3 * f**2, f**2]) / 2
