"""A-posteriori precision of a matched patch, honest on weak texture and smoothed images."""

from __future__ import annotations

from typing import Any

import numpy as np

from tracker.arrays import Array, Array32
from tracker.kernels.compilation import compiled
from tracker.kernels.patches.equations import AFFINE, N_PARAMETERS, Noise, Rule, Workspace, factorize, solve


@compiled
def estimate_precision(found: Array, squares: float, spread: float, rule: Rule, noise: Noise, work: Workspace) -> bool:
    """A-posteriori sigma0 and the covariance of the shift, corrected for weak texture and correlated noise.

    Noise n in the images enlarges the normal matrix N by the power of its own gradients G, but these gradients
    say nothing about the shift: its covariance is ``2 s^2 (N - G)^-1 N (N - G)^-1``, not ``sigma0^2 N^-1``. Where
    the images were smoothed, neighbouring residuals agree by chance: s^2 follows from sigma0 by the power that
    the smoothing leaves, and the noise passes the estimator through the smoothing.
    """
    half, _, _, _, prior, classical = rule
    residual_gain, gradient_gain, taps = noise
    design, _, _, _, normal, factor, vectors, padded = work
    size = 2 * half + 1
    n = size * size
    sigma0_2 = max(squares, 0.0) / (n - N_PARAMETERS)
    raw = sigma0_2 / residual_gain
    gradients = raw * gradient_gain * n
    by_affine = (half + 1) / (3.0 * half)
    for k in range(N_PARAMETERS):
        vectors[2, k] = normal[k, k]
    for k in range(6):
        normal[k, k] -= gradients * (1.0 if k % 3 == 0 else by_affine)
    regular = factorize(normal, factor)
    for k in range(N_PARAMETERS):
        normal[k, k] = vectors[2, k]
    if not regular:
        return False
    for axis in range(2):
        row = vectors[2 + axis]
        row[:] = 0.0
        row[3 * axis] = 1.0
        solve(factor, row)
    xx, yy, xy = _propagated(design, vectors, size, taps, padded)
    weight = prior / half**2
    for k in AFFINE:
        xx += weight * vectors[2, k] ** 2
        yy += weight * vectors[3, k] ** 2
        xy += weight * vectors[2, k] * vectors[3, k]
    a, b, c, d = found[2], found[3], found[4], found[5]
    if classical:
        a, b, c, d = 1.0, 0.0, 0.0, 1.0
    found[8] = np.sqrt(sigma0_2)
    found[9] = 2.0 * raw * (a * a * xx + 2.0 * a * b * xy + b * b * yy)
    found[10] = 2.0 * raw * (c * c * xx + 2.0 * c * d * xy + d * d * yy)
    found[11] = 2.0 * raw * (a * c * xx + (a * d + b * c) * xy + b * d * yy)
    found[12] = np.sqrt(max(0.0, 1.0 - squares / (n * spread * spread)))
    return True


@compiled(fastmath=True)
def _propagated(design: Array32, vectors: Array, size: int, taps: Array32, padded: Array32) -> tuple[Any, Any, Any]:
    """Variances and covariance of both shifts for white noise of variance 1 that was smoothed with the taps."""
    n_taps = len(taps)
    wide = size + n_taps - 1
    lead = wide * n_taps
    for axis in range(2):
        influence, passed = padded[axis], padded[2]
        _influence(design, vectors[2 + axis], size, wide, lead, influence)
        if n_taps > 1:
            # what a patch of another size has left there
            passed[:lead] = np.float32(0.0)
            _correlate(influence, taps, 1, lead, size * wide, passed)
            passed[lead + size * wide :] = np.float32(0.0)
            _correlate(passed, taps, wide, lead, wide * wide, influence)
    xx = yy = xy = np.float32(0.0)
    along, down = padded[0, lead : lead + wide * wide], padded[1, lead : lead + wide * wide]
    for i in range(wide * wide):
        xx += along[i] * along[i]
        yy += down[i] * down[i]
        xy += along[i] * down[i]
    return xx, yy, xy


@compiled(fastmath=True)
def _influence(design: Array32, row: Array, size: int, wide: int, lead: int, out: Array32) -> None:
    """How much each residual moves a shift; rows padded with zeros."""
    r0, r1, r2, r3 = np.float32(row[0]), np.float32(row[1]), np.float32(row[2]), np.float32(row[3])
    r4, r5, r6, r7 = np.float32(row[4]), np.float32(row[5]), np.float32(row[6]), np.float32(row[7])
    out[:] = np.float32(0.0)
    for y in range(size):
        part, line = design[:, y * size : (y + 1) * size], out[lead + y * wide : lead + y * wide + size]
        for x in range(size):
            first = r0 * part[0, x] + r1 * part[1, x] + r2 * part[2, x] + r3 * part[3, x]
            second = r4 * part[4, x] + r5 * part[5, x] + r6 * part[6, x] + r7 * part[7, x]
            line[x] = first + second


@compiled(fastmath=True)
def _correlate(values: Array32, taps: Array32, stride: int, lead: int, n: int, out: Array32) -> None:
    """Sums of n values and those so many strides before them, weighted with the taps."""
    # Slices, because an index that might be negative keeps the compiler from vectorizing.
    sums = out[lead : lead + n]
    sums[:] = np.float32(0.0)
    for t in range(len(taps)):
        weight, behind = taps[t], values[lead - t * stride : lead - t * stride + n]
        for i in range(n):
            sums[i] += weight * behind[i]
