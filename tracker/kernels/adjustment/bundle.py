"""Normal equations of a bundle adjustment, reduced to the cameras object by object (Schur complement).

An object is what moves as a whole between two exposures and has six unknowns of its own: the two ends of a reference
bar, the pose of a board, or a single point. Its unknowns are eliminated as soon as its observations are summed up,
so that only the cameras' equations are ever solved together.
"""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Integers, Mask
from tracker.kernels.adjustment.projecting import project_with_slopes
from tracker.kernels.compilation import compiled
from tracker.kernels.rows.bundle_unknown import N_UNKNOWNS

N_OBJECT = 6
"""Unknowns of an object."""

Observed = tuple[Integers, Integers, Array, Array, Array]
"""N observations: their views (N,), points (N,), pixels (N, 2), image velocities (N, 2) px per frame, weights (N,)."""

Objects = tuple[Array, Array, Integers, Array, Array]
"""Points (P, 3), their slopes (P, 3, 6) by the unknowns of their object, the first observation of each object (G+1,),
and what is known of the objects beforehand: normal matrices (G, 6, 6) and right sides (G, 6)."""

Reduced = tuple[Array, Array, Array, Array, Array]
"""Outputs: normal matrix (17V, 17V) and right side (17V,), and for the way back to the objects their inverse
normal matrices (G, 6, 6), right sides (G, 6) and couplings with the cameras (G, V, 6, 17)."""


@compiled
def residuals_of(cameras: Array, points: Array, observed: Observed, residuals: Array) -> None:
    """Observed minus projected pixels.

    Args:
        cameras: (V, 26) states.
        points: (P, 3) metres.
        observed: the observations.
        residuals: (N, 2) output, px; NaN behind the camera.
    """
    views, numbers, pixels, velocities, _ = observed
    by_camera, by_point = np.empty((2, N_UNKNOWNS)), np.empty((2, 3))
    for n in range(len(views)):
        u, v, before = project_with_slopes(cameras[views[n]], points[numbers[n]], velocities[n], by_camera, by_point)
        residuals[n, 0] = pixels[n, 0] - u if before else np.nan
        residuals[n, 1] = pixels[n, 1] - v if before else np.nan


@compiled
def reduce_normal(cameras: Array, objects: Objects, observed: Observed, damping: float, reduced: Reduced) -> None:
    """Sums up the normal equations and eliminates the unknowns of every object.

    Args:
        cameras: (V, 26) states.
        objects: points and objects.
        observed: observations, those of an object one after another; of weight 0, they count for nothing.
        damping: Levenberg-Marquardt's; added to every diagonal element as a share of it.
        reduced: outputs.
    """
    points, slopes, firsts, priors, prior_sides = objects
    views, numbers, pixels, velocities, weights = observed
    normal, side, inverses, object_sides, couplings = reduced
    n_views = len(cameras)
    normal[:], side[:], couplings[:] = 0.0, 0.0, 0.0
    by_camera, by_point = np.empty((2, N_UNKNOWNS)), np.empty((2, 3))
    by_object = np.empty((2, N_OBJECT))
    own, seen = np.empty((N_OBJECT, N_OBJECT)), np.zeros(n_views, dtype=np.bool_)
    for g in range(len(firsts) - 1):
        own[:], object_sides[g], seen[:] = priors[g], prior_sides[g], False
        for n in range(firsts[g], firsts[g + 1]):
            view, number, weight = views[n], numbers[n], weights[n]
            if weight == 0.0:
                continue
            u, v, before = project_with_slopes(cameras[view], points[number], velocities[n], by_camera, by_point)
            if not before:
                continue
            seen[view] = True
            by_object[:] = 0.0
            for k in range(3):
                for j in range(N_OBJECT):
                    by_object[0, j] += by_point[0, k] * slopes[number, k, j]
                    by_object[1, j] += by_point[1, k] * slopes[number, k, j]
            for axis in range(2):
                error = pixels[n, axis] - (u if axis == 0 else v)
                slopes_of = by_camera[axis], by_object[axis]
                _add(slopes_of, weight, error, view, (normal, side), (own, object_sides[g], couplings[g]))
        for j in range(N_OBJECT):
            own[j, j] += damping * own[j, j]
        _invert(own, inverses[g])
        _eliminate(inverses[g], object_sides[g], couplings[g], seen, normal, side)
    _damp(normal, damping)


@compiled
def _damp(normal: Array, damping: float) -> None:
    """Fills the lower triangle's twin and damps; a share of what elimination left keeps the matrix definite."""
    for i in range(len(normal)):
        normal[i, i] += damping * normal[i, i]
        for j in range(i):
            normal[j, i] = normal[i, j]


@compiled
def _add(
    slopes: tuple[Array, Array],
    weight: float,
    error: float,
    view: int,
    cameras: tuple[Array, Array],
    own_object: tuple[Array, Array, Array],
) -> None:
    """Adds one image coordinate: its slopes by camera and object, to the cameras' and the object's equations."""
    by_camera, by_object = slopes
    normal, side = cameras
    own, own_side, couplings = own_object
    first, coupling = view * N_UNKNOWNS, couplings[view]
    for i in range(N_UNKNOWNS):
        weighted = weight * by_camera[i]
        side[first + i] += weighted * error
        row = normal[first + i, first : first + N_UNKNOWNS]
        for j in range(i + 1):
            row[j] += weighted * by_camera[j]
    for i in range(N_OBJECT):
        weighted = weight * by_object[i]
        own_side[i] += weighted * error
        for j in range(N_UNKNOWNS):
            coupling[i, j] += weighted * by_camera[j]
        for j in range(N_OBJECT):
            own[i, j] += weighted * by_object[j]


@compiled
def _invert(matrix: Array, inverse: Array) -> None:
    """Inverse of a symmetric positive definite matrix by Cholesky; zero where it is not definite."""
    n = len(matrix)
    lower = np.zeros((n, n))
    inverse[:] = 0.0
    for i in range(n):
        for j in range(i + 1):
            value = matrix[i, j]
            for k in range(j):
                value -= lower[i, k] * lower[j, k]
            if i > j:
                lower[i, j] = value / lower[j, j]
            elif value > 1e-13 * matrix[i, i]:
                lower[i, i] = np.sqrt(value)
            else:
                return
    for column in range(n):
        solution = np.zeros(n)
        for i in range(column, n):
            value = 1.0 if i == column else 0.0
            for k in range(column, i):
                value -= lower[i, k] * solution[k]
            solution[i] = value / lower[i, i]
        for i in range(n - 1, -1, -1):
            value = solution[i]
            for k in range(i + 1, n):
                value -= lower[k, i] * inverse[k, column]
            inverse[i, column] = value / lower[i, i]


@compiled
def _eliminate(inverse: Array, own_side: Array, couplings: Array, seen: Mask, normal: Array, side: Array) -> None:
    """Subtracts from the cameras' equations what an object's unknowns take up."""
    taken = np.empty((N_UNKNOWNS, N_OBJECT))
    for view in range(len(seen)):
        if not seen[view]:
            continue
        first = view * N_UNKNOWNS
        taken[:] = 0.0
        for j in range(N_OBJECT):
            for k in range(N_OBJECT):
                for i in range(N_UNKNOWNS):
                    taken[i, j] += couplings[view, k, i] * inverse[k, j]
            for i in range(N_UNKNOWNS):
                side[first + i] -= taken[i, j] * own_side[j]
        for other in range(view + 1):
            if seen[other]:
                _subtract(taken, couplings[other], normal[first : first + N_UNKNOWNS], other * N_UNKNOWNS)


@compiled
def _subtract(taken: Array, coupling: Array, rows: Array, start: int) -> None:
    """Subtracts a product (17, 6) (6, 17) from a block; sums stand in registers, columns innermost for vectors."""
    n = N_UNKNOWNS
    for i in range(n):
        row = rows[i, start : start + n]
        a, b, c, d, e, f = taken[i, 0], taken[i, 1], taken[i, 2], taken[i, 3], taken[i, 4], taken[i, 5]
        for j in range(n):
            row[j] -= (
                a * coupling[0, j]
                + b * coupling[1, j]
                + c * coupling[2, j]
                + d * coupling[3, j]
                + e * coupling[4, j]
                + f * coupling[5, j]
            )
