"""Triangulated superquadrics."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tracker.foundation.arrays import Array, Integers, frozen
from tracker.foundation.geometry.superquadrics import spread, surface


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

    The first latitude and the last are poles: triangles there that have no area are left out.
    """
    rows, columns = np.meshgrid(np.arange(n_eta - 1), np.arange(n_omega), indexing="ij")
    a, b = rows * n_omega + columns, rows * n_omega + (columns + 1) % n_omega
    lower = np.stack([a, b, a + n_omega], axis=-1)[1:].reshape(-1, 3)
    upper = np.stack([b, b + n_omega, a + n_omega], axis=-1)[:-1].reshape(-1, 3)
    return frozen(np.concatenate([lower, upper]), np.int64)
