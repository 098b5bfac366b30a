"""Distances of surface points from the outside of a body, with derivatives by shape and pose."""

from __future__ import annotations

import numpy as np

from tracker.acquisition._residuals import Rows, asks_of, patches_of
from tracker.acquisition.clouds import Cloud
from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array, Integers
from tracker.foundation.geometry.superquadrics import signed_distance


def outside(placed: Array, shapes: Array, points: Array) -> tuple[Integers, Array, Array]:
    """Where points are against the outside of all parts together.

    Args:
        placed: (P, 4, 4) placements of the parts.
        shapes: (P, 7) packed superquadrics.
        points: (N, 3) in the world, metres.

    Returns:
        (N,) the part that is the outer one there; (N, 3) the nearest place on its surface, to second order, metres;
        (N, 3) the normal there.
    """
    local = (points - placed[:, None, :3, 3]) @ placed[:, :3, :3]
    distances = np.array([signed_distance(shape, own)[0] for shape, own in zip(shapes, local, strict=True)])
    part = distances.argmin(axis=0)
    feet, normals = np.empty_like(points), np.empty_like(points)
    for p in np.unique(part):
        rows, turn = part == p, placed[p, :3, :3]
        distance, away = signed_distance(shapes[p], local[p, rows])
        # a second step: the first one ends beside a curved surface
        foot = local[p, rows] - distance[:, None] * away
        distance, away = signed_distance(shapes[p], foot)
        foot -= distance[:, None] * away
        feet[rows] = foot @ turn.T + placed[p, :3, 3]
        normals[rows] = away @ turn.T
    return part, feet, normals


def surface_rows(
    cloud: Cloud, body: BodyModel, q: Array, gate: tuple[float, float], noise: tuple[float, float]
) -> Rows:
    """Rows of the points of a cloud: the body's surface less the point, along the normal, metres.

    Each counts as the square that it stands for, in squares of the length over which the model departs from a body
    alike; one that is far off, or whose surface faces elsewhere, counts little or nothing.

    Args:
        cloud: the points.
        body: the body.
        q: (dof,) pose.
        gate: largest distance, metres, and largest angle between the normals, degrees.
        noise: standard deviation of the model from a body, metres, and the length over which it is alike, metres.
    """
    gate_m, (noise_m, alike_m) = gate[0], noise
    part, feet, normals = outside(body.world_from_part(q), body.shapes, cloud.points)
    residuals = ((feet - cloud.points) * normals).sum(axis=1)
    facing = np.abs((normals * cloud.normals).sum(axis=1)) >= np.cos(np.radians(gate[1]))
    kept = facing & (np.abs(residuals) <= gate_m)
    residuals, part, feet, normals = residuals[kept], part[kept], feet[kept], normals[kept]
    precise = noise_m**2 / (noise_m**2 + cloud.sigmas[kept] ** 2)
    worth = precise * (cloud.spacing_m / alike_m) ** 2
    return Rows(
        residuals=residuals,
        asks=asks_of(body, q, feet, part, normals),
        lengths_m=np.full(len(part), 2 * cloud.spacing_m**2 / alike_m),
        parts=part,
        views=np.full(len(part), -1),
        inner=np.zeros(len(part), dtype=np.bool_),
        weights=worth / (1 + (residuals / (0.5 * gate_m)) ** 2) ** 2,
        patches=patches_of(body, q, feet, part),
    )
