"""Distances of surface points and followed points from a body, with derivatives by its shape and pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tracker.acquisition._residuals import Bodies, Rows, asks_of, patches_of
from tracker.acquisition.clouds import Cloud
from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array, Integers
from tracker.foundation.geometry.superquadrics import signed_distance


def outside(placed: Array, shapes: Array, points: Array) -> tuple[Integers, Array, Array]:
    """Distances of points from the outside of all parts together.

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


# Points followed from moment to moment: each stays where it is on its part, wherever that is.


@dataclass(frozen=True)
class Tracks:
    """N points in K moments."""

    places: Array
    """(K, N, 3) in the world, metres; NaN where a point is not seen."""

    sigmas: Array
    """(K, N) standard deviation of a coordinate, metres."""

    spacing_m: float
    """Each point stands for a square of this length, metres."""


@dataclass(frozen=True)
class Tied:
    """Information of the tracks on shape and poses, linearized."""

    matrix: Array
    """(n, n) J^T W J of all unknowns."""

    vector: Array
    """(n,) J^T W r."""

    squares: float
    """Sum of w r^2, square metres."""

    total: float
    """Sum of w over the residuals that places on the parts leave."""


def tied(
    tracks: Tracks, bodies: Bodies, poses: Array, columns: Sequence[Integers], gate_m: float, noise: tuple[float, float]
) -> Tied:
    """The equations of all tracks that two moments or more show.

    The place l of a point on its part is unknown and drops out: what is left is how the places that the moments give,
    ``l_k = R_k^T (x_k - t_k)``, differ from their mean (variable projection: Golub & Pereyra 1973).

    Args:
        tracks: the points.
        bodies: the body and its neighbours in the shape space.
        poses: (Q,) all pose values.
        columns: (K,) where the pose of each moment is among them.
        gate_m: a track that departs by half of it has a quarter of its weight, metres.
        noise: standard deviation of a point against a rigid part, metres, and length over which it is alike, metres.
    """
    n_shape, n = len(bodies[2]), len(bodies[2]) + len(poses)
    part = _carriers(tracks, bodies, poses, columns)
    seen = np.isfinite(tracks.places[..., 0])
    kept = np.flatnonzero((seen.sum(axis=0) >= 2) & (part >= 0))
    local = np.zeros((len(columns), len(kept), 3))
    slopes = np.zeros((len(columns), len(kept), 3, n))
    for k, own in enumerate(columns):
        rows = np.flatnonzero(seen[k, kept])
        which = kept[rows]
        place, by_shape, by_pose = _on_parts(bodies, poses[own], tracks.places[k, which], part[which])
        local[k, rows] = place
        slopes[k, rows, :, :n_shape] = by_shape
        slopes[k][np.ix_(rows, np.arange(3), n_shape + own)] = by_pose
    there = seen[:, kept]
    counts = there.sum(axis=0)
    # places and their slopes are 0 in moments that do not show the point
    residuals = np.where(there[..., None], local.sum(axis=0) / counts[:, None] - local, 0.0)
    total = slopes.sum(axis=0)
    spread = (residuals**2).sum(axis=(0, 2))
    rms = np.sqrt(spread / (3 * np.maximum(counts - 1, 1)))
    sigma = np.where(there, tracks.sigmas[:, kept], 0.0).max(axis=0)
    worth = (tracks.spacing_m / noise[1]) ** 2 * noise[0] ** 2 / (noise[0] ** 2 + sigma**2)
    weights = worth / (1 + (rms / (0.5 * gate_m)) ** 2) ** 2
    flat, means = slopes.reshape(-1, n), total.reshape(-1, n)
    each = np.broadcast_to(weights[None, :, None], residuals.shape).reshape(-1, 1)
    matrix = flat.T @ (each * flat) - means.T @ (np.repeat(weights / counts, 3)[:, None] * means)
    # the mean falls as the places rise: r = mean - l, and its slope is the mean of the slopes less their own
    vector = -flat.T @ (each[:, 0] * residuals.reshape(-1))
    return Tied(matrix, vector, float((weights * spread).sum()), float((3 * weights * (counts - 1)).sum()))


def _carriers(tracks: Tracks, bodies: Bodies, poses: Array, columns: Sequence[Integers]) -> Integers:
    """(N,) the part that is nearest to each point in most moments; -1 for points that are never seen."""
    body = bodies[0]
    votes = np.zeros((len(body.parts), tracks.places.shape[1]))
    for k, own in enumerate(columns):
        seen = np.flatnonzero(np.isfinite(tracks.places[k, :, 0]))
        if len(seen):
            part, _, _ = outside(body.world_from_part(poses[own]), body.shapes, tracks.places[k, seen])
            votes[part, seen] += 1
    found: Integers = np.where(votes.any(axis=0), votes.argmax(axis=0), -1)
    return found


def _on_parts(bodies: Bodies, q: Array, points: Array, parts: Integers) -> tuple[Array, Array, Array]:
    """Places (N, 3) of world points in their parts' frames, and how they change with shape (N, 3, S), pose (N, 3, dof).

    A part's frame is taken relative to its joints: that its ends move along it is no motion of the body.
    """
    body, neighbours, steps = bodies
    placed = body.world_from_part(q)
    moved = np.moveaxis(neighbours.placements(q)[0] - placed, 0, -1) / steps
    rotations = placed[parts, :3, :3]
    local = np.einsum("nji,nj->ni", rotations, points - placed[parts, :3, 3])
    with_one = np.concatenate([local, np.ones((len(local), 1))], axis=1)
    by_shape = -np.einsum("nji,njks,nk->nis", rotations, moved[parts, :3], with_one)
    carried = body.point_jacobian(q, points, body.part_parameters[parts])
    by_pose = -np.einsum("nji,njk->nik", rotations, carried)
    return local, by_shape, by_pose
