"""Smoothing splines, their smoothness chosen by generalized cross-validation."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_smoothing_spline
from scipy.linalg import solveh_banded

from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.results.smoothing import Stretch, Stretchwise

_PENALTIES = np.logspace(-4, 10, 57)
"""Tested weights of the integral of the squared second derivative, in usual intervals: from no smoothing to a
thousandth of a cycle a frame."""


@component
class Spline(Stretchwise):
    """Cubic smoothing spline, one a parameter (Craven & Wahba 1979; Woltring 1986 in biomechanics).

    Frames have equal weights: sigmas contain more than jitter. Velocities and accelerations are its own, and
    accelerations are 0 at both ends; for joints that turn about three axes, see `tracker.results.smoothing`.
    """

    def _smoothed(self, stretch: Stretch) -> Array:
        return self._courses(stretch)[0]

    def _courses(self, stretch: Stretch) -> tuple[Array, Array, Array]:
        times, poses = stretch.times_s[stretch.known], stretch.poses[stretch.known]
        interval_s = float(np.median(np.diff(stretch.times_s)))
        splines = [
            make_smoothing_spline(times, column, lam=penalty * interval_s**3)
            for column, penalty in zip(poses.T, _validated(times / interval_s, poses), strict=True)
        ]
        smooth, velocities, accelerations = (
            np.stack([spline(stretch.times_s, nu=nu) for spline in splines], axis=1) for nu in range(3)
        )
        return smooth, velocities, accelerations


def _validated(times: Array, columns: Array) -> Array:
    """(dof,) penalties of the least generalized cross-validation error of columns (T, dof) at times (T,).

    All penalties are tried: searching downhill, as SciPy does, made a straight line of five in 22 angles of a person
    who walks on the spot. The second derivatives of a spline solve a system of five diagonals (Reinsch 1967; Green &
    Silverman 1994, section 2.3): ``(R + penalty Q'Q) c = Q'y``, and ``penalty Q c`` is the residual.
    """
    steps = np.diff(times)
    before, behind = 1 / steps[:-1], 1 / steps[1:]
    middle = -(before + behind)
    differences = before[:, None] * columns[:-2] + middle[:, None] * columns[1:-1] + behind[:, None] * columns[2:]
    # each of three diagonals: the middle one, and those above it
    rough = [(steps[:-1] + steps[1:]) / 3, steps[1:-1] / 6, np.zeros(len(middle) - 2)]
    bends = [
        before**2 + middle**2 + behind**2,
        middle[:-1] * before[1:] + behind[:-1] * middle[1:],
        behind[:-2] * before[2:],
    ]
    squares = np.zeros((len(_PENALTIES), columns.shape[1]))
    for k, penalty in enumerate(_PENALTIES):
        bands = [np.pad(one + penalty * other, (j, 0)) for j, (one, other) in enumerate(zip(rough, bends, strict=True))]
        curved = penalty * solveh_banded(np.array(bands[::-1]), differences)
        left = np.zeros_like(columns)
        left[:-2] += before[:, None] * curved
        left[1:-1] += middle[:, None] * curved
        left[2:] += behind[:, None] * curved
        squares[k] = (left**2).sum(axis=0)
    tried = [one[:, None] + other[:, None] * _PENALTIES for one, other in zip(rough, bends, strict=True)]
    free = _PENALTIES * _trace(tried, bends)  # of the frames, those that the spline does not follow
    best: Array = _PENALTIES[(squares / free[:, None] ** 2).argmin(axis=0)]
    return best


def _trace(matrices: list[Array], factor: list[Array]) -> Array:
    """(K,) traces of a matrix times the inverses of K others, all symmetric and of five diagonals.

    Only five diagonals of an inverse count; they are found one after the other (Hutchinson & de Hoog 1985).

    Args:
        matrices: their diagonals (N, K), the middle one first, then those above it, shorter by one and two.
        factor: diagonals of the matrix (N,).
    """
    (main, first, second), n = matrices, len(matrices[0])
    nothing = np.zeros_like(main[0])
    pivots, one, two = np.zeros_like(main), np.zeros_like(main), np.zeros_like(main)
    for i in range(n):
        pivots[i] = main[i] - one[i - 1] ** 2 * pivots[i - 1] - two[i - 2] ** 2 * pivots[i - 2]
        if i < n - 1:
            one[i] = (first[i] - one[i - 1] * two[i - 1] * pivots[i - 1]) / pivots[i]
        if i < n - 2:
            two[i] = second[i] / pivots[i]
    sums, here, aside, beyond = nothing, nothing, nothing, nothing
    for i in reversed(range(n)):
        # of the inverse: from the rows i + 1 and i + 2 to row i
        near = -one[i] * here - two[i] * aside
        far = -one[i] * aside - two[i] * beyond
        beyond, here, aside = here, 1 / pivots[i] - one[i] * near - two[i] * far, near
        sums = sums + factor[0][i] * here
        if i < n - 1:
            sums = sums + 2 * factor[1][i] * near
        if i < n - 2:
            sums = sums + 2 * factor[2][i] * far
    traces: Array = sums
    return traces
