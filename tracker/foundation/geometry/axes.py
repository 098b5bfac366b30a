"""Lines in space from planes and rays."""

from __future__ import annotations

import numpy as np

from tracker.foundation.arrays import Array


def line_from_planes(normals: Array, points: Array) -> tuple[Array, Array, float]:
    """The line that planes have in common, in the least squares sense.

    Args:
        normals: (V, 3) unit normals.
        points: (V, 3) a point on each plane, metres.

    Returns:
        A point (3,) on the line, its unit direction (3,), and how well it is determined: the middle singular
        value of the normals, 0 where all planes are parallel.
    """
    _, values, rows = np.linalg.svd(normals, full_matrices=True)
    direction = rows[2]
    # Of all points on the line the one nearest to the planes' points keeps the numbers small.
    centre = points.mean(axis=0)
    offsets = ((points - centre) * normals).sum(axis=1)
    shift, *_ = np.linalg.lstsq(normals, offsets, rcond=1e-6)
    strength = float(values[1]) if len(values) > 1 else 0.0
    return centre + shift, direction, strength


def nearest_along_line(point: Array, direction: Array, origin: Array, rays: Array) -> tuple[Array, Array]:
    """Where viewing rays pass a line.

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
