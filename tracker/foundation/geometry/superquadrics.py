"""Tapered superquadrics as plain functions of the packed row a1 a2 a3 e1 e2 k1 k2."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tracker.foundation.arrays import Array, Integers, frozen

# Keeps powers of 0 finite.
_TINY = 1e-12


def _signed_power(base: Array, exponent: float) -> Array:
    powered: Array = np.sign(base) * np.abs(base) ** exponent
    return powered


def surface(shape: Array, eta: Array, omega: Array) -> tuple[Array, Array]:
    """Surface points and outward normals.

    Args:
        shape: (7,) packed superquadric.
        eta: (...) latitude, rad, -pi/2 to pi/2.
        omega: (...) longitude, rad.

    Returns:
        Points (..., 3) metres and unit normals (..., 3) in the part's frame. The normal of a tapered
        surface is the inverse transposed Jacobian of the taper times the normal of the straight one.
    """
    a1, a2, a3, e1, e2, k1, k2 = shape
    ring, height = _signed_power(np.cos(eta), e1), _signed_power(np.sin(eta), e1)
    x = a1 * ring * _signed_power(np.cos(omega), e2)
    y = a2 * ring * _signed_power(np.sin(omega), e2)
    grow_x, grow_y = 1 + k1 * height, 1 + k2 * height
    points = np.stack(np.broadcast_arrays(grow_x * x, grow_y * y, a3 * height), axis=-1)
    ring_n = _signed_power(np.cos(eta), 2 - e1)
    nx = ring_n * _signed_power(np.cos(omega), 2 - e2) / a1
    ny = ring_n * _signed_power(np.sin(omega), 2 - e2) / a2
    nz = _signed_power(np.sin(eta), 2 - e1) / a3
    nx, ny = nx / grow_x, ny / grow_y
    nz = nz - (k1 / a3) * x * nx - (k2 / a3) * y * ny
    normals = np.stack(np.broadcast_arrays(nx, ny, nz), axis=-1)
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), _TINY)
    return points, normals


def inside_outside(shape: Array, points: Array) -> Array:
    """Inside-outside function of a tapered superquadric.

    ``F = ((x/a1 fx)^(2/e2) + (y/a2 fy)^(2/e2))^(e2/e1) + (z/a3)^(2/e1)`` with ``fx = 1 + k1 z/a3``.

    Args:
        shape: (7,) packed superquadric.
        points: (..., 3) metres, in the part's frame.

    Returns:
        (...) below 1 inside, 1 on the surface, above 1 outside.
    """
    a1, a2, a3, e1, e2, k1, k2 = shape
    height = points[..., 2] / a3
    clamped = np.clip(height, -1, 1)
    x = np.abs(points[..., 0] / (a1 * (1 + k1 * clamped)))
    y = np.abs(points[..., 1] / (a2 * (1 + k2 * clamped)))
    around = (x ** (2 / e2) + y ** (2 / e2)) ** (e2 / e1)
    value: Array = around + np.abs(height) ** (2 / e1)
    return value


def signed_distance(shape: Array, points: Array) -> tuple[Array, Array]:
    """Distances from the surface to first order, and the direction away from it (Taubin 1991, section 3.1).

    ``(f - 1) / |grad f|`` of ``f = F^(e1/2)``, which grows linearly from the middle: exact for spheres and for the
    sides of cylinders and boxes.

    Args:
        shape: (7,) packed superquadric.
        points: (..., 3) metres, in the part's frame.

    Returns:
        (...) metres, negative inside; (..., 3) unit vectors.
    """
    a1, a2, a3, e1, e2, k1, k2 = shape
    height = np.clip(points[..., 2] / a3, -1, 1)
    within = np.abs(points[..., 2]) < a3
    grow_x, grow_y = 1 + k1 * height, 1 + k2 * height
    x, y = (np.maximum(np.abs(points[..., k]), _TINY) for k in range(2))
    z = np.maximum(np.abs(points[..., 2]), _TINY) / a3
    u, v = x / (a1 * grow_x), y / (a2 * grow_y)
    ring = np.maximum(u ** (2 / e2) + v ** (2 / e2), _TINY)
    value = ring ** (e2 / e1) + z ** (2 / e1)
    # the slopes of F by ring, and of the ring by u and v, without the factor 2 / e1 that all have
    by_ring = ring ** (e2 / e1 - 1)
    by_u, by_v = by_ring * u ** (2 / e2 - 1), by_ring * v ** (2 / e2 - 1)
    taper = (by_u * u * k1 / grow_x + by_v * v * k2 / grow_y) * within / a3
    slopes = np.stack(
        [
            np.sign(points[..., 0]) * by_u / (a1 * grow_x),
            np.sign(points[..., 1]) * by_v / (a2 * grow_y),
            np.sign(points[..., 2]) * z ** (2 / e1 - 1) / a3 - taper,
        ],
        axis=-1,
    )
    steepness = np.maximum(np.linalg.norm(slopes, axis=-1), _TINY)
    f = value ** (e1 / 2)
    distances: Array = (f - 1) / (value ** (e1 / 2 - 1) * steepness)
    return distances, slopes / steepness[..., None]


def shape_derivatives(shape: Array, points: Array) -> Array:
    """Movement of surface points of fixed latitude and longitude with the shape.

    Args:
        shape: (7,) packed superquadric, or (7, ...) one for each point.
        points: (..., 3) on the surface, in the part's frame, metres.

    Returns:
        (..., 3, 7) derivatives with respect to a1 a2 a3 e1 e2 k1 k2; metres per unit.
    """
    a1, a2, a3, e1, e2, k1, k2 = shape
    height = np.clip(points[..., 2] / a3, -1, 1)
    grow_x, grow_y = 1 + k1 * height, 1 + k2 * height
    x, y = points[..., 0] / grow_x, points[..., 1] / grow_y
    around = np.maximum(np.abs(x / a1) ** (2 / e2) + np.abs(y / a2) ** (2 / e2), _TINY)
    log_sin_eta = np.log(np.maximum(np.abs(height), _TINY)) / e1
    log_cos_eta = np.log(around) * e2 / (2 * e1)
    log_cos_omega = 0.5 * np.log(np.maximum(np.abs(x / a1) ** (2 / e2) / around, _TINY))
    log_sin_omega = 0.5 * np.log(np.maximum(np.abs(y / a2) ** (2 / e2) / around, _TINY))
    moved = np.zeros((*points.shape, 7))
    rise = height * log_sin_eta
    moved[..., 0, 0], moved[..., 1, 1], moved[..., 2, 2] = points[..., 0] / a1, points[..., 1] / a2, height
    moved[..., 0, 3] = points[..., 0] * log_cos_eta + k1 * x * rise
    moved[..., 1, 3] = points[..., 1] * log_cos_eta + k2 * y * rise
    moved[..., 2, 3] = a3 * rise
    moved[..., 0, 4], moved[..., 1, 4] = points[..., 0] * log_cos_omega, points[..., 1] * log_sin_omega
    moved[..., 0, 5], moved[..., 1, 6] = x * height, y * height
    return moved


def spread(shape: Array, n_eta: int, n_omega: int) -> tuple[Array, Array]:
    """Latitudes and longitudes that spread evenly over the shape, both by arc length and by turning.

    Even steps of eta crowd at the rim of a boxy shape and leave its sides bare; half of the steps follow the
    profile's length, half its change of direction.

    Args:
        shape: (7,) packed superquadric.
        n_eta: number of latitudes, both poles included.
        n_omega: number of longitudes around.

    Returns:
        eta (n_eta,) and omega (n_omega,), rad.
    """
    fine = np.linspace(-np.pi / 2, np.pi / 2, 721)
    eta = _resample(shape, fine, np.zeros_like(fine), fine, n_eta)
    around = np.linspace(-np.pi, np.pi, 1441)
    omega = _resample(shape, np.zeros_like(around), around, around, n_omega + 1)[:-1]
    return eta, omega


def _resample(shape: Array, eta: Array, omega: Array, parameter: Array, n: int) -> Array:
    points, normals = surface(shape, eta, omega)
    length = np.linalg.norm(np.diff(points, axis=0), axis=1)
    cosine = (normals[1:] * normals[:-1]).sum(axis=1).clip(-1, 1)
    travel = length / length.sum() + np.arccos(cosine) / np.arccos(cosine).sum()
    position = np.concatenate([[0.0], np.cumsum(travel)])
    even: Array = np.interp(np.linspace(0, position[-1], n), position, parameter)
    return even


def box_bounds(shapes: Array) -> Array:
    """(3, P) bounds of packed shapes (P, 7) for `place_solids`: those of the boxes around them."""
    size, growth = shapes[:, :3], 1 + np.abs(shapes[:, 5:7])
    across = np.linalg.norm(size[:, :2] * growth, axis=1)
    return frozen([np.hypot(across, size[:, 2]), (growth**2).sum(axis=1) + 1, across])


# Triangulated superquadrics.


@dataclass(frozen=True)
class Meshes:
    """Triangulated parts in their own frames, all with the same triangles."""

    points: Array
    """(P, N, 3) metres."""

    normals: Array
    """(P, N, 3) unit."""

    triangles: Integers
    """(T, 3) vertex numbers, anticlockwise seen from outside."""

    widths: Array
    """(P,) largest distance of the surface from the part's z axis, metres."""


def meshes_of(shapes: Array, n_eta: int, n_omega: int) -> Meshes:
    """Meshes of packed superquadrics (P, 7), kept for the shapes last used."""
    return _triangulated(shapes.tobytes(), n_eta, n_omega)


@lru_cache(maxsize=8)
def _triangulated(shapes: bytes, n_eta: int, n_omega: int) -> Meshes:
    points, normals = [], []
    for shape in np.frombuffer(shapes).reshape(-1, 7):
        eta, omega = spread(shape, n_eta, n_omega)
        found = surface(shape, eta[:, None], omega[None, :])
        points.append(found[0].reshape(-1, 3))
        normals.append(found[1].reshape(-1, 3))
    widths = np.linalg.norm(np.array(points)[..., :2], axis=-1).max(axis=1)
    return Meshes(frozen(points), frozen(normals), _grid_triangles(n_eta, n_omega), frozen(widths))


def _grid_triangles(n_eta: int, n_omega: int) -> Integers:
    """Triangles (T, 3) between the points of a grid of latitudes and longitudes, anticlockwise seen from outside.

    The first latitude and the last are poles: triangles without area are left out.
    """
    rows, columns = np.meshgrid(np.arange(n_eta - 1), np.arange(n_omega), indexing="ij")
    a, b = rows * n_omega + columns, rows * n_omega + (columns + 1) % n_omega
    lower = np.stack([a, b, a + n_omega], axis=-1)[1:].reshape(-1, 3)
    upper = np.stack([b, b + n_omega, a + n_omega], axis=-1)[:-1].reshape(-1, 3)
    return frozen(np.concatenate([lower, upper]), np.int64)
