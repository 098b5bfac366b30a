"""Adaptive least squares matching of image patches (Gruen 1985): six affine and two radiometric parameters."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Integers
from tracker.kernels.compilation import compiled
from tracker.kernels.patches.equations import (
    AFFINE,
    N_PARAMETERS,
    Noise,
    Rule,
    Workspace,
    complete_design,
    dot,
    factorize,
    moments,
    normal_matrix,
    residuals,
    solve,
    workspace,
)
from tracker.kernels.patches.sigma import estimate_precision
from tracker.kernels.patches.splines import SplineImage, reaches_out, sample_gradient, sample_patch, sample_whole_pixels

MATCHED, NOT_CONVERGED, DRIFTED, OUTSIDE, WEAK = 0, 1, 2, 3, 4
"""How a match ended; WEAK: the patch has too little texture, or looks like its negative."""

WARP, SIGMA0, COVARIANCE, CORRELATION, HALF_PATCH, N_FOUND = slice(0, 6), 8, slice(9, 12), 12, 14, 15
"""Columns of what is found.

0-5 centre px and affine matrix row by row, 6-7 brightness and contrast, 8 sigma0 grey levels, 9-11 variances and
covariance of the shift xx yy xy px^2, 12 correlation, 13 iterations, 14 half the patch px.
"""

# Grey levels: rounding.
_NO_TEXTURE = 1e-3


@compiled
def match_patch(
    template: SplineImage, search: SplineImage, at: Array, found: Array, rule: Rule, noise: Noise, work: Workspace
) -> int:
    """Finds a template patch in another image.

    The inverse-compositional form linearizes the template once; the classical form of Gruen (1985) linearizes
    the search image at every iteration. Both minimize the squares of ``brightness + contrast g(A x + c) - f(x)``.

    Args:
        template, search: spline coefficients, width and height of both images.
        at: (2,) centre of the template patch, px.
        found: (15,) holds the start in its first six columns, and the result after: see the columns' names.
        rule: see `Rule`.
        noise: see `Noise`.
        work: from `workspace`.

    Returns:
        How the match ended.
    """
    half, most, tolerance, farthest, _, classical = rule
    n, vectors = (2 * half + 1) ** 2, work[6]
    start, step, identity = vectors[0], vectors[1], vectors[3]
    identity[:6] = at[0], at[1], 1.0, 0.0, 0.0, 1.0
    start[:6] = found[WARP]
    if reaches_out(identity, half, template[1], template[2]) or reaches_out(found, half, search[1], search[2]):
        return OUTSIDE
    mean, spread = _fix_template(template, identity, rule, work)
    if not spread > 0.0:
        return WEAK
    before = 0.0
    for iteration in range(most):
        squares = _linearize(search, found, (mean, spread), iteration == 0, rule, work)
        if not squares >= 0.0:
            return WEAK
        vectors[2] = step
        solve(work[5], step)
        for k in range(N_PARAMETERS):
            squares -= step[k] * vectors[2, k]
        if classical:
            moved = _added(found, step, half, moments(work[2], n))
        else:
            moved = _composed(found, step, half, (mean, spread))
        if not (abs(found[0] - start[0]) <= farthest and abs(found[1] - start[1]) <= farthest):
            return DRIFTED
        if reaches_out(found, half, search[1], search[2]):
            return OUTSIDE
        # Steps shrink by a nearly constant factor: what is left to go is their geometric series.
        if moved < 0.1 * tolerance or moved * moved < tolerance * (before - moved):
            found[13], found[14] = iteration + 1, half
            precise = found[7] > 0.0 and estimate_precision(found, squares, spread, rule, noise, work)
            return MATCHED if precise else WEAK
        before = moved
    return NOT_CONVERGED


@compiled
def _fix_template(template: SplineImage, identity: Array, rule: Rule, work: Workspace) -> tuple[float, float]:
    """Samples the template patch, whose normal equations the inverse form solves once for all iterations.

    Returns:
        Mean and standard deviation of its grey values; a deviation of 0 where it has no texture.
    """
    half, _, _, _, prior, classical = rule
    design, fixed, _, _, normal, factor, _, _ = work
    n = (2 * half + 1) ** 2
    column, row = int(np.floor(identity[0])), int(np.floor(identity[1]))
    if identity[0] == column and identity[1] == row:
        sample_whole_pixels(template, column, row, half, fixed, design[0], design[3])
    else:
        sample_gradient(template, identity, half, fixed, design[0], design[3])
    mean, spread = moments(fixed, n)
    if not spread > _NO_TEXTURE:
        return mean, 0.0
    if not classical:
        complete_design(design, fixed, (mean, spread), 1.0, half)
        normal_matrix(design, n, prior / half**2, normal)
        if not factorize(normal, factor):
            return mean, 0.0
    return mean, spread


@compiled
def _linearize(
    search: SplineImage, found: Array, of_template: tuple[float, float], first: bool, rule: Rule, work: Workspace
) -> float:
    """Right side of the normal equations at the present warp, and for the classical form the equations themselves.

    Returns:
        Sum of the squared residuals, grey levels; -1 where there is no texture.
    """
    half, _, _, _, prior, classical = rule
    design, fixed, grey, residual, normal, factor, vectors, _ = work
    n = (2 * half + 1) ** 2
    if classical:
        sample_gradient(search, found, half, grey, design[0], design[3])
    else:
        sample_patch(search, found, half, grey)
    if first or classical:
        mean, spread = moments(grey, n)
        if not spread > _NO_TEXTURE:
            return -1.0
        if first:
            found[7] = of_template[1] / spread
            found[6] = of_template[0] - found[7] * mean
        if classical:
            complete_design(design, grey, (mean, spread), found[7], half)
            normal_matrix(design, n, prior / half**2, normal)
            if not factorize(normal, factor):
                return -1.0
    residuals(fixed, grey, found[6], found[7], n, residual)
    # A step of the template brings it to the search patch; a step of the search patch brings it to the template.
    sign = -1.0 if classical else 1.0
    for k in range(N_PARAMETERS):
        vectors[1, k] = sign * dot(design[k], residual, n)
    for j in range(4):
        vectors[1, AFFINE[j]] += sign * prior / half * (found[2 + j] - vectors[0, 2 + j])
    return dot(residual, residual, n)


@compiled
def _composed(found: Array, step: Array, half: int, of_template: tuple[float, float]) -> float:
    """Inverse composition: warp and radiometry after the inverse of the template's step.

    Returns:
        How far a corner moved, px.
    """
    a, b, c, d = 1.0 + step[1] / half, step[2] / half, step[4] / half, 1.0 + step[5] / half
    inverse = 1.0 / (a * d - b * c)
    m0, m1, m2, m3 = d * inverse, -b * inverse, -c * inverse, a * inverse
    w2, w3, w4, w5 = found[2], found[3], found[4], found[5]
    found[2], found[3] = w2 * m0 + w3 * m2, w2 * m1 + w3 * m3
    found[4], found[5] = w4 * m0 + w5 * m2, w4 * m1 + w5 * m3
    found[0] -= found[2] * step[0] + found[3] * step[3]
    found[1] -= found[4] * step[0] + found[5] * step[3]
    growth = step[7] / of_template[1]
    found[6] = (found[6] - step[6] + growth * of_template[0]) / (1.0 + growth)
    found[7] /= 1.0 + growth
    return _reach(step)


@compiled
def _added(found: Array, step: Array, half: int, of_search: tuple[float, float]) -> float:
    """The classical update: parameters add up; returns how far a corner moved, px."""
    found[0] += step[0]
    found[1] += step[3]
    found[2] += step[1] / half
    found[3] += step[2] / half
    found[4] += step[4] / half
    found[5] += step[5] / half
    growth = step[7] / of_search[1]
    found[6] += step[6] - growth * of_search[0]
    found[7] += growth
    return _reach(step)


@compiled
def _reach(step: Array) -> float:
    return max(abs(step[0]) + abs(step[1]) + abs(step[2]), abs(step[3]) + abs(step[4]) + abs(step[5]))


@compiled
def match_patches(
    template: SplineImage, search: SplineImage, at: Array, found: Array, ended: Integers, rule: Rule, noise: Noise
) -> None:
    """Matches N patches; see `match_patch`.

    Args:
        template, search, rule, noise: see `match_patch`.
        at: (N, 2) centres of the template patches, px.
        found: (N, 15) holds the starts, and the results after.
        ended: (N,) written: how each match ended.
    """
    work = workspace(rule[0], len(noise[2]))
    for k in range(len(at)):
        ended[k] = match_patch(template, search, at[k], found[k], rule, noise, work)
