"""Gruen's linearized equations of a patch: design matrix, normal matrix, their solution."""

from __future__ import annotations

from typing import Any

import numpy as np

from tracker.arrays import Array, Array32
from tracker.kernels.compilation import compiled

N_PARAMETERS = 8
"""Two shifts, four of the affinity, gain and offset of the grey values (Gruen 1985)."""

AFFINE = (1, 2, 4, 5)
"""Positions of the four affine terms; 0 and 3 are the shifts, 6 and 7 brightness and contrast."""

Rule = tuple[int, int, float, float, float, bool]
"""Half patch px, most iterations, tolerance px, farthest shift px, prior's weight, classical form."""

Noise = tuple[float, float, Array32]
"""Powers that white noise keeps in residuals and in gradients; taps of the smoothing that the images went through."""

Workspace = tuple[Array32, Array32, Array32, Array32, Array, Array, Array, Array32]
"""Design (8, n), template, search patch and residuals (n,), normal matrix and its factor (8, 8), vectors, filter."""


@compiled
def workspace(half: int, n_taps: int) -> Workspace:
    """What a match writes to on its way: design, template, search patch, residuals, normal equations, filter."""
    n, padded = (2 * half + 1) ** 2, 2 * half + n_taps
    return (
        np.zeros((N_PARAMETERS, n), dtype=np.float32),
        np.zeros(n, dtype=np.float32),
        np.zeros(n, dtype=np.float32),
        np.zeros(n, dtype=np.float32),
        np.zeros((N_PARAMETERS, N_PARAMETERS)),
        np.zeros((N_PARAMETERS, N_PARAMETERS)),
        np.zeros((4, N_PARAMETERS)),
        np.zeros((3, padded * (padded + n_taps)), dtype=np.float32),
    )


@compiled(fastmath=True)
def dot(a: Array32, b: Array32, n: int) -> Any:
    """Scalar product of the first n values."""
    total = np.float32(0.0)
    for i in range(n):
        total += a[i] * b[i]
    return total


@compiled(fastmath=True)
def moments(values: Array32, n: int) -> tuple[Any, Any]:
    """Mean and standard deviation."""
    total = np.float32(0.0)
    for i in range(n):
        total += values[i]
    mean = total / np.float32(n)
    squares = np.float32(0.0)
    for i in range(n):
        squares += (values[i] - mean) * (values[i] - mean)
    return mean, np.sqrt(squares / np.float32(n))


@compiled
def factorize(matrix: Array, factor: Array) -> bool:
    """Cholesky factor of a matrix (8, 8); False where a parameter cannot be determined.

    That is where a pivot loses five digits, or where gradients are below a thousandth of a grey level per pixel.
    """
    least = 1e-6 * matrix[6, 6]
    for i in range(N_PARAMETERS):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i > j:
                factor[i, j] = total / factor[j, j]
            elif total > 1e-5 * matrix[i, i] and total > least:
                factor[i, i] = np.sqrt(total)
            else:
                return False
    return True


@compiled
def solve(factor: Array, right: Array) -> None:
    """Solves in place with the factor of the matrix."""
    for i in range(N_PARAMETERS):
        total = right[i]
        for k in range(i):
            total -= factor[i, k] * right[k]
        right[i] = total / factor[i, i]
    for back in range(N_PARAMETERS):
        i = N_PARAMETERS - 1 - back
        total = right[i]
        for k in range(i + 1, N_PARAMETERS):
            total -= factor[k, i] * right[k]
        right[i] = total / factor[i, i]


@compiled(fastmath=True)
def complete_design(design: Array32, grey: Array32, moments: tuple[float, float], gain: float, half: int) -> None:
    """Columns of Gruen's design matrix from gradients in columns 0 and 3; lengths in halves of the patch.

    Order: shift x, its growth along x and y, shift y, its growth along x and y, brightness, contrast.
    """
    size, scale = 2 * half + 1, np.float32(1.0 / half)
    mean, slope, factor = np.float32(moments[0]), np.float32(1.0 / moments[1]), np.float32(gain)
    for j in range(size):
        v = np.float32(j - half) * scale
        for i in range(size):
            u, k = np.float32(i - half) * scale, j * size + i
            along, down = design[0, k] * factor, design[3, k] * factor
            design[0, k], design[1, k], design[2, k] = along, along * u, along * v
            design[3, k], design[4, k], design[5, k] = down, down * u, down * v
            design[6, k], design[7, k] = np.float32(1.0), (grey[k] - mean) * slope


@compiled
def normal_matrix(design: Array32, n: int, prior: float, normal: Array) -> None:
    """J^T J, with the prior's weight on the four affine terms."""
    for i in range(N_PARAMETERS):
        for j in range(i + 1):
            normal[i, j] = normal[j, i] = dot(design[i], design[j], n)
    for k in AFFINE:
        normal[k, k] += prior


@compiled(fastmath=True)
def residuals(template: Array32, grey: Array32, brightness: float, contrast: float, n: int, out: Array32) -> None:
    """Search patch, radiometrically adjusted, minus template; n grey values."""
    shift, scale = np.float32(brightness), np.float32(contrast)
    for i in range(n):
        out[i] = shift + scale * grey[i] - template[i]
