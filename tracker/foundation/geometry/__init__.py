"""Pure geometry: lines in space, rigid motions, points that fill a box evenly; superquadrics in a file of their own."""

from __future__ import annotations

import itertools

import numpy as np

from tracker.foundation.arrays import Array


def line_from_planes(normals: Array, points: Array) -> tuple[Array, Array, float]:
    """The common line of planes, by least squares.

    Args:
        normals: (V, 3) unit normals.
        points: (V, 3) a point on each plane, metres.

    Returns:
        A point (3,) on the line, its unit direction (3,), and how well it is determined: the middle singular value of
        the normals, 0 for parallel planes.
    """
    _, values, rows = np.linalg.svd(normals, full_matrices=True)
    direction = rows[2]
    # The point on the line nearest to the planes' points keeps the numbers small.
    centre = points.mean(axis=0)
    offsets = ((points - centre) * normals).sum(axis=1)
    shift, *_ = np.linalg.lstsq(normals, offsets, rcond=1e-6)
    strength = float(values[1]) if len(values) > 1 else 0.0
    return centre + shift, direction, strength


def nearest_along_line(point: Array, direction: Array, origin: Array, rays: Array) -> tuple[Array, Array]:
    """Points of a line nearest to viewing rays.

    Args:
        point, direction: (3,) the line; the direction has unit length.
        origin: (3,) common origin of the rays.
        rays: (N, 3) unit directions.

    Returns:
        Position along the line (N,) of the point nearest to each ray, and their distance (N,), metres.
    """
    offset = origin - point
    b = rays @ direction
    d, e = rays @ offset, direction @ offset
    denominator = np.maximum(1 - b * b, 1e-12)
    along_ray = (b * e - d) / denominator
    along_line = e + along_ray * b
    gap = offset + along_ray[:, None] * rays - along_line[:, None] * direction
    return along_line, np.linalg.norm(gap, axis=1)


def rigid_motion(points: Array, targets: Array) -> Array:
    """(4, 4) rotation and shift that bring points nearest to their targets, by least squares and without scale.

    By singular values (Kabsch 1976, Arun et al. 1987); never a reflection. With points on a line the turn about it
    is open, with one point every turn: the result is one of the nearest motions. `Rotation.align_vectors` of scipy
    gives the same to 1e-15; it refuses a single point, warns of a line, and takes twice as long.

    Args:
        points: (N, 3).
        targets: (N, 3). Rows with a NaN in either are left out; one at least must stay.
    """
    known = np.isfinite(points).all(axis=1) & np.isfinite(targets).all(axis=1)
    points, targets = points[known], targets[known]
    middle, there = points.mean(axis=0), targets.mean(axis=0)
    u, _, vt = np.linalg.svd((points - middle).T @ (targets - there))
    proper = np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))])
    motion = np.eye(4)
    motion[:3, :3] = vt.T @ proper @ u.T
    motion[:3, 3] = there - motion[:3, :3] @ middle
    return motion


def halton(n: int, n_dimensions: int) -> Array:
    """The first points of Halton's sequence (Halton 1960), (n, n_dimensions) in [0, 1).

    Coordinate d of point i is the radical inverse of i in base p, the d-th prime: the digits of i mirrored at the
    point, ``sum_k a_k p^(-k - 1)`` for ``i = sum_k a_k p^k``. The first point is the origin.

    `scipy.stats.qmc.Halton` gives the same points; scipy.stats takes 0.2 to 0.5 s to import, at the start of every run.
    """
    columns = [_radical_inverses(n, base) for base in _primes(n_dimensions)]
    return np.stack(columns, axis=1) if columns else np.empty((n, 0))


def _radical_inverses(n: int, base: int) -> Array:
    left, inverses, weight = np.arange(n), np.zeros(n), 1.0 / base
    while left.any():
        left, digits = np.divmod(left, base)
        inverses += digits * weight
        weight /= base
    return inverses


def _primes(n: int) -> list[int]:
    found: list[int] = []
    candidates = itertools.count(2)
    while len(found) < n:
        candidate = next(candidates)
        if all(candidate % prime for prime in found):
            found.append(candidate)
    return found
