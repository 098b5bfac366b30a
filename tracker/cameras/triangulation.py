"""Points from their images in several views, with covariances."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array, Mask


def triangulate(cameras: Sequence[Camera], pixels: Array, sigma_px: float = 1.0) -> tuple[Array, Array]:
    """Points of least reprojection error: linear start on the viewing rays, then Gauss-Newton.

    Args:
        cameras: the V views.
        pixels: (V, N, 2) px, NaN where a view does not show the point.
        sigma_px: standard deviation of an image coordinate.

    Returns:
        World points (N, 3) metres and their covariances (N, 3, 3) m^2, ``sigma^2 (J^T J)^-1``; NaN for points
        seen by fewer than two views, and for rays that are parallel or part in front of the cameras.
    """
    pixels = np.asarray(pixels, dtype=np.float64)
    seen: Mask = np.asarray(np.isfinite(pixels).all(axis=2))
    good: Mask = np.asarray(seen.sum(axis=0) >= 2)
    points = np.full((pixels.shape[1], 3), np.nan)
    covariances = np.full((pixels.shape[1], 3, 3), np.nan)
    if not good.any():
        return points, covariances
    pixels, seen = pixels[:, good], seen[:, good]
    found, seen = _nearest_to_rays(cameras, pixels, seen)
    for _ in range(10):
        normal, step = _reprojection_step(cameras, pixels, seen, found)
        found = found + step
        if not (np.abs(step) > 1e-10).any():
            break
    points[good] = found
    covariances[good] = sigma_px**2 * _solved(normal, np.broadcast_to(np.eye(3), normal.shape))
    return points, covariances


def _nearest_to_rays(cameras: Sequence[Camera], pixels: Array, seen: Mask) -> tuple[Array, Mask]:
    """(N, 3) points with the least sum of squared distances to their viewing rays; (V, N) which of these there are."""
    matrix, vector = np.zeros((pixels.shape[1], 3, 3)), np.zeros((pixels.shape[1], 3))
    seen = seen.copy()
    for v, camera in enumerate(cameras):
        rays = camera.rays(np.where(seen[v][:, None], pixels[v], camera.matrix[:2, 2]))
        # a pixel that the lens images nothing to is no image of a point
        seen[v] &= np.isfinite(rays).all(axis=1)
        rays = np.where(seen[v][:, None], rays, 0.0)
        across = (np.eye(3) - rays[:, :, None] * rays[:, None, :]) * seen[v][:, None, None]
        matrix += across
        vector += across @ camera.centre
    return _solved(matrix, vector[..., None])[..., 0], seen


def _reprojection_step(cameras: Sequence[Camera], pixels: Array, seen: Mask, points: Array) -> tuple[Array, Array]:
    """Normal matrix (N, 3, 3) and Gauss-Newton step (N, 3) of the reprojection error."""
    normal, gradient = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3))
    for v, camera in enumerate(cameras):
        projected = camera.project(points)
        used = seen[v] & np.isfinite(projected).all(axis=1)
        residual = np.where(used[:, None], pixels[v] - projected, 0.0)
        jacobian = np.where(used[:, None, None], camera.project_jacobian(points), 0.0)
        normal += np.swapaxes(jacobian, 1, 2) @ jacobian
        gradient += np.einsum("nij,ni->nj", jacobian, residual)
    return normal, _solved(normal, gradient[..., None])[..., 0]


def _solved(matrix: Array, right: Array) -> Array:
    """Solutions (N, 3, K) of N symmetric systems (N, 3, 3), (N, 3, K); NaN for singular ones, not a failure of all."""
    size = np.trace(matrix, axis1=1, axis2=2) / 3
    regular = np.linalg.det(matrix) > 1e-14 * size**3
    solution = np.full(right.shape, np.nan)
    solution[regular] = np.linalg.solve(matrix[regular], right[regular])
    return solution
