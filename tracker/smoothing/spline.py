"""Smoothing splines, their smoothness chosen by generalized cross-validation."""

from __future__ import annotations

import numpy as np
from scipy.fft import dct
from scipy.interpolate import make_smoothing_spline

from tracker.arrays import Array
from tracker.components import component
from tracker.smoothing import Stretch
from tracker.smoothing._stretchwise import Stretchwise, without_gaps

_PENALTIES = np.logspace(-4, 10, 57)
"""Weights of squared second differences that are tried: from no smoothing to a thousandth of a cycle a frame."""


@component
class Spline(Stretchwise):
    """Cubic smoothing spline, one a parameter (Craven & Wahba 1979; Woltring 1986 in biomechanics).

    Frames weigh the same: sigmas tell of more than jitter. Accelerations are 0 at both ends.
    """

    def _smoothed(self, stretch: Stretch) -> Array:
        times, poses = stretch.times_s[stretch.known], stretch.poses[stretch.known]
        filled, interval_s = without_gaps(stretch), float(np.median(np.diff(stretch.times_s)))
        # the integral of the squared second derivative is the sum of squared second differences over the interval cubed
        splines = [
            make_smoothing_spline(times, column, lam=penalty * interval_s**3)
            for column, penalty in zip(poses.T, _validated(filled), strict=True)
        ]
        return np.stack([spline(stretch.times_s) for spline in splines], axis=1)


def _validated(columns: Array) -> Array:
    """(dof,) penalties of the least generalized cross-validation error of columns (T, dof) at even times.

    In cosines the smoother is diagonal (Garcia 2010, eqs. 8, 13, 14), so that all penalties are tried: searching
    downhill, as SciPy does, made a straight line of five in 22 angles of somebody who walks on the spot.
    """
    n = len(columns)
    waves = dct(columns, axis=0, norm="ortho") ** 2
    bends = (2 - 2 * np.cos(np.pi * np.arange(n) / n)) ** 2
    kept = 1 / (1 + _PENALTIES[:, None] * bends)
    left = (1 - kept) ** 2 @ waves / n
    best: Array = _PENALTIES[(left / (1 - kept.mean(axis=1, keepdims=True)) ** 2).argmin(axis=0)]
    return best
