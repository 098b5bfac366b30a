"""Forward ray intersection of many points, weighted by the precision of their images."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array
from tracker.kernels.compilation import compiled
from tracker.kernels.lens import bend_with_slopes, lens_of
from tracker.kernels.rows import camera as at


@compiled
def _image_with_slopes(camera: Array, point: Array, slopes: Array) -> tuple[float, float, bool]:
    """Image of a point with its derivatives (2, 3) by the position; the twins are `Camera.project(_jacobian)`."""
    x = camera[at.R11] * point[0] + camera[at.R12] * point[1] + camera[at.R13] * point[2] + camera[at.TX]
    y = camera[at.R21] * point[0] + camera[at.R22] * point[1] + camera[at.R23] * point[2] + camera[at.TY]
    z = camera[at.R31] * point[0] + camera[at.R32] * point[1] + camera[at.R33] * point[2] + camera[at.TZ]
    if not z > 1e-9:
        return 0.0, 0.0, False
    a, b = x / z, y / z
    u, v, aa, ab, bb = bend_with_slopes(lens_of(camera), a, b, 1.0)
    fx, fy, shear = camera[at.FX], camera[at.FY], camera[at.SHEAR]
    ua, ub, va, vb = fx * aa + shear * ab, fx * ab + shear * bb, fy * ab, fy * bb
    uz, vz = -(ua * a + ub * b), -(va * a + vb * b)
    for k in range(3):
        slopes[0, k] = (ua * camera[at.R11 + k] + ub * camera[at.R21 + k] + uz * camera[at.R31 + k]) / z
        slopes[1, k] = (va * camera[at.R11 + k] + vb * camera[at.R21 + k] + vz * camera[at.R31 + k]) / z
    return fx * u + shear * v + camera[at.CX], fy * v + camera[at.CY], True


@compiled
def _normal_equations(
    cameras: Array, pixels: Array, variances: Array, point: Array, normal: Array, right: Array
) -> tuple[float, int]:
    """Fills the normal equations of one point (3, 3), (3,).

    Returns:
        Sum of the squared residuals px^2, and the number of views that show the point; 0 behind a camera.
    """
    slopes = np.zeros((2, 3))
    normal[:], right[:] = 0.0, 0.0
    squares, n_views = 0.0, 0
    for v in range(len(cameras)):
        xx, yy, xy = variances[v]
        determinant = xx * yy - xy * xy
        if not (np.isfinite(pixels[v, 0]) and determinant > 0.0):
            continue
        u, w, before = _image_with_slopes(cameras[v], point, slopes)
        if not before:
            return np.inf, 0
        dx, dy = pixels[v, 0] - u, pixels[v, 1] - w
        wxx, wyy, wxy = yy / determinant, xx / determinant, -xy / determinant
        for i in range(3):
            gx = wxx * slopes[0, i] + wxy * slopes[1, i]
            gy = wxy * slopes[0, i] + wyy * slopes[1, i]
            right[i] += gx * dx + gy * dy
            for j in range(3):
                normal[i, j] += gx * slopes[0, j] + gy * slopes[1, j]
        squares += dx * dx + dy * dy
        n_views += 1
    return squares, n_views


@compiled
def _inverse(m: Array, out: Array) -> bool:
    """Inverse of a symmetric matrix (3, 3); False for a singular one."""
    out[0, 0] = m[1, 1] * m[2, 2] - m[1, 2] * m[1, 2]
    out[0, 1] = out[1, 0] = m[0, 2] * m[1, 2] - m[0, 1] * m[2, 2]
    out[0, 2] = out[2, 0] = m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1]
    out[1, 1] = m[0, 0] * m[2, 2] - m[0, 2] * m[0, 2]
    out[1, 2] = out[2, 1] = m[0, 1] * m[0, 2] - m[0, 0] * m[1, 2]
    out[2, 2] = m[0, 0] * m[1, 1] - m[0, 1] * m[0, 1]
    determinant = m[0, 0] * out[0, 0] + m[0, 1] * out[0, 1] + m[0, 2] * out[0, 2]
    size = (m[0, 0] + m[1, 1] + m[2, 2]) / 3.0
    if not determinant > 1e-14 * size**3:
        return False
    out /= determinant
    return True


@compiled
def intersect_rays(
    cameras: Array, pixels: Array, variances: Array, points: Array, covariances: Array, residuals: Array
) -> None:
    """Gauss-Newton on the weighted reprojection error of N points.

    Args:
        cameras: (V, 29) rows of `Rig.packed`.
        pixels: (V, N, 2) px, NaN where a view does not show the point.
        variances: (V, N, 3) of the pixels: xx, yy, xy, px^2.
        points: (N, 3) holds the starts, and the points after, metres; NaN where fewer than two views meet.
        covariances: (N, 3, 3) written, m^2.
        residuals: (N,) written: RMS of the reprojection over the coordinates, px.
    """
    normal, right, inverse = np.zeros((3, 3)), np.zeros(3), np.zeros((3, 3))
    for k in range(len(points)):
        for _ in range(_MOST_STEPS):
            squares, n_views = _normal_equations(cameras, pixels[:, k], variances[:, k], points[k], normal, right)
            if n_views < 2 or not _inverse(normal, inverse):
                n_views = 0
                break
            step2 = 0.0
            for i in range(3):
                step = inverse[i, 0] * right[0] + inverse[i, 1] * right[1] + inverse[i, 2] * right[2]
                points[k, i] += step
                step2 += step * step
            if step2 < _SMALL_STEP_M**2:
                break
        if n_views < 2:
            points[k], covariances[k], residuals[k] = np.nan, np.nan, np.inf
            continue
        squares, n_views = _normal_equations(cameras, pixels[:, k], variances[:, k], points[k], normal, right)
        covariances[k] = inverse
        residuals[k] = np.sqrt(squares / (2 * n_views))


# A bound: from the linear intersection each Newton step doubles the digits.
_MOST_STEPS = 10
# Far below any measurement, far above rounding.
_SMALL_STEP_M = 1e-8
