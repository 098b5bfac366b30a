"""Normal equations of a bundle adjustment, reduced to the cameras object by object (Schur complement).

An object is what moves as a whole between two exposures and has six unknowns of its own: the two ends of a reference
bar, the pose of a board, or a single point. Its unknowns are eliminated as soon as its observations are summed up,
so that only the cameras' equations are ever solved together.
"""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Integers, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.lens import LensTerms, bend_with_slopes
from tracker.kernels.rows import bundle_camera as state
from tracker.kernels.rows import bundle_unknown as unknown
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
def project_with_slopes(
    camera: Array, point: Array, velocity: Array, by_camera: Array, by_point: Array
) -> tuple[float, float, bool]:
    """Image of a point with its derivatives; the twin is `Camera.project`.

    Args:
        camera: (26,) state, see `tracker.kernels.rows.bundle_camera`.
        point: (3,) world position, metres.
        velocity: (2,) velocity of the image, px per frame; the time offset shifts along it.
        by_camera: (2, 17) output; rotations act after the camera's own, positions are the centre's.
        by_point: (2, 3) output.

    Returns:
        Pixel u, v, and whether the point lies before the camera; if it does not, the slopes are 0.
    """
    by_camera[:], by_point[:] = 0.0, 0.0
    dx, dy, dz = point[0] - camera[state.X], point[1] - camera[state.Y], point[2] - camera[state.Z]
    px = camera[state.R11] * dx + camera[state.R12] * dy + camera[state.R13] * dz
    py = camera[state.R21] * dx + camera[state.R22] * dy + camera[state.R23] * dz
    pz = camera[state.R31] * dx + camera[state.R32] * dy + camera[state.R33] * dz
    if pz <= 1e-6:
        return 0.0, 0.0, False
    inverse = 1.0 / pz
    x, y = px * inverse, py * inverse
    r2 = x * x + y * y
    xd, yd, xx, xy, yy = bend_with_slopes(_lens(camera), x, y, 1.0)
    c, stretch, shear = camera[state.C], 1.0 + camera[state.AFFINITY], camera[state.SHEAR]
    # pixels by plane coordinates
    ux, uy = c * (stretch * xx + shear * xy), c * (stretch * xy + shear * yy)
    vx, vy = c * xy, c * yy
    # pixels by coordinates in the camera
    ucx, ucy, ucz = ux * inverse, uy * inverse, -(ux * x + uy * y) * inverse
    vcx, vcy, vcz = vx * inverse, vy * inverse, -(vx * x + vy * y) * inverse
    by_camera[0, unknown.TURN_X], by_camera[1, unknown.TURN_X] = py * ucz - pz * ucy, py * vcz - pz * vcy
    by_camera[0, unknown.TURN_Y], by_camera[1, unknown.TURN_Y] = pz * ucx - px * ucz, pz * vcx - px * vcz
    by_camera[0, unknown.TURN_Z], by_camera[1, unknown.TURN_Z] = px * ucy - py * ucx, px * vcy - py * vcx
    for k in range(3):
        by_point[0, k] = ucx * camera[state.R11 + k] + ucy * camera[state.R21 + k] + ucz * camera[state.R31 + k]
        by_point[1, k] = vcx * camera[state.R11 + k] + vcy * camera[state.R21 + k] + vcz * camera[state.R31 + k]
        by_camera[0, unknown.X + k], by_camera[1, unknown.X + k] = -by_point[0, k], -by_point[1, k]
    by_camera[0, unknown.C], by_camera[1, unknown.C] = stretch * xd + shear * yd, yd
    by_camera[0, unknown.CX] = by_camera[1, unknown.CY] = 1.0
    by_camera[0, unknown.AFFINITY], by_camera[0, unknown.SHEAR] = c * xd, c * yd
    k4, k5, k6 = camera[state.K4], camera[state.K5], camera[state.K6]
    power = r2 / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    for k in (unknown.K1, unknown.K2, unknown.K3):
        by_camera[0, k] = c * (stretch * x + shear * y) * power
        by_camera[1, k] = c * y * power
        power *= r2
    xp1, yp1 = 2.0 * x * y, r2 + 2.0 * y * y
    xp2, yp2 = r2 + 2.0 * x * x, 2.0 * x * y
    by_camera[0, unknown.P1], by_camera[1, unknown.P1] = c * (stretch * xp1 + shear * yp1), c * yp1
    by_camera[0, unknown.P2], by_camera[1, unknown.P2] = c * (stretch * xp2 + shear * yp2), c * yp2
    by_camera[0, unknown.DELAY], by_camera[1, unknown.DELAY] = velocity[0], velocity[1]
    u = c * (stretch * xd + shear * yd) + camera[state.CX] + camera[state.DELAY] * velocity[0]
    return u, c * yd + camera[state.CY] + camera[state.DELAY] * velocity[1], True


@compiled
def _lens(camera: Array) -> LensTerms:
    return (
        camera[state.K1],
        camera[state.K2],
        camera[state.P1],
        camera[state.P2],
        camera[state.K3],
        camera[state.K4],
        camera[state.K5],
        camera[state.K6],
    )


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
