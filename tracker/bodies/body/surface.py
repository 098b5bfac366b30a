"""The surface of a body as one mesh, each vertex on its part and segment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.skin import MOST_BONES
from tracker.foundation.arrays import Array, Integers
from tracker.foundation.geometry.superquadrics import signed_distance


@dataclass(frozen=True)
class Surface:
    """The parts' surfaces in the reference pose, metres."""

    points: Array
    """(N, 3) vertices."""

    normals: Array
    """(N, 3) outwards, unit length."""

    parts: Integers
    """(N,) part that each vertex is of."""

    segments: Integers
    """(N,) segment that each vertex hangs on."""

    faces: Integers
    """(F, 3) vertices, all of one part, against the clock as seen from outside."""


def surface_of(body: BodyModel, n_eta: int, n_omega: int) -> Surface:
    """Meshes all parts of a body.

    Args:
        body: whose parts they are.
        n_eta: latitudes of a part's mesh, poles included.
        n_omega: longitudes.
    """
    eta, omega = np.meshgrid(np.linspace(-np.pi / 2, np.pi / 2, n_eta), 2 * np.pi * np.arange(n_omega) / n_omega)
    points, normals = [], []
    for part in body.parts:
        local, upright = part.shape.surface(eta.T, omega.T)
        turn, shift = part.model_from_part[:3, :3], part.model_from_part[:3, 3]
        points.append(local.reshape(-1, 3) @ turn.T + shift)
        normals.append(upright.reshape(-1, 3) @ turn.T)
    one = _triangles(n_eta, n_omega)
    faces = np.concatenate([one + k * n_eta * n_omega for k in range(len(body.parts))])
    parts = np.repeat(np.arange(len(body.parts)), n_eta * n_omega)
    segments = body.segments_of_parts[parts]
    return Surface(np.concatenate(points), np.concatenate(normals), parts, segments, faces)


@dataclass(frozen=True)
class Skinned:
    """A body's surface for programs that animate meshes: vertices that up to four segments move."""

    points: Array
    """(N, 3) vertices in the rest pose, metres."""

    normals: Array
    """(N, 3) outwards, unit length."""

    faces: Integers
    """(F, 3) vertices, against the clock as seen from outside."""

    segments: Integers
    """(N, 4) segments that move each vertex."""

    weights: Array
    """(N, 4) their weights; the sum is 1."""

    segment_from_given: Array
    """(S, 4, 4) from the rest pose to each segment's own axes."""


def skinned_of(body: BodyModel, n_eta: int, n_omega: int) -> Skinned:
    """The skin of a body, or else the surfaces of its parts.

    Args:
        body: owner of the surface.
        n_eta: latitudes of a part's mesh, poles included.
        n_omega: longitudes.
    """
    segment_from_given = np.tile(np.eye(4), (len(body.segments), 1, 1))
    segment_from_given[:, :3, 3] = [-segment.joint for segment in body.segments]
    if body.skin is None:
        surface = surface_of(body, n_eta, n_omega)
        segments = np.pad(surface.segments[:, None], ((0, 0), (0, 3)))
        weights = np.tile([1.0, 0, 0, 0], (len(segments), 1))
        return Skinned(surface.points, surface.normals, surface.faces, segments, weights, segment_from_given)
    names = [segment.name for segment in body.segments]
    shares = np.zeros((len(body.skin.points), len(names)))
    for p, part in enumerate(body.parts):
        k = names.index(part.segment)
        shares[:, k] += body.skin.weights[:, p]
        segment_from_given[k] = part.model_from_part @ body.skin.part_from_rest[p]
        segment_from_given[k, :3, 3] -= body.segments[k].joint
    segments = np.argsort(-shares, axis=1, kind="stable")[:, :MOST_BONES]
    weights = np.take_along_axis(shares, segments, axis=1)
    missing = ((0, 0), (0, MOST_BONES - segments.shape[1]))
    segments, weights = np.pad(np.where(weights > 0, segments, 0), missing), np.pad(weights, missing)
    normals = np.asarray(body.skin.normals, dtype=np.float64)
    return Skinned(body.skin.points, normals, body.skin.faces, segments, weights, segment_from_given)


def _triangles(n_eta: int, n_omega: int) -> Integers:
    """(F, 3) vertices of the faces, against the clock as seen from outside; at the poles one a column, not two."""
    rows, columns = np.meshgrid(np.arange(n_eta - 1), np.arange(n_omega), indexing="ij")
    right = (columns + 1) % n_omega
    low, high = rows * n_omega, (rows + 1) * n_omega
    lower = np.stack([low + columns, low + right, high + right], axis=-1)[1:]
    upper = np.stack([low + columns, high + right, high + columns], axis=-1)[:-1]
    return np.concatenate([lower.reshape(-1, 3), upper.reshape(-1, 3)])


def segments_in_world(body: BodyModel, q: Array) -> Array:
    """Placements of the segments (..., S, 4, 4): origin in the joint, axes of the reference pose, metres."""
    placed = np.array(body.world_from_parameters(q)[..., [segment.end for segment in body.segments], :, :])
    joints = np.array([segment.joint for segment in body.segments])
    placed[..., :3, 3] += (placed[..., :3, :3] @ joints[..., None])[..., 0]
    return placed


def nearest_parts(points: Array, placements: Array, shapes: Array) -> tuple[Integers, Array, Array]:
    """The part whose surface is nearest to each point; where parts overlap, the outer one.

    Args:
        points: (N, 3) in the world, metres.
        placements: (P, 4, 4) of the parts in the world.
        shapes: (P, 7) packed superquadrics.

    Returns:
        (N,) part; (N,) signed distance from its surface, metres; (N,) how much farther the next part is, metres.
    """
    distances = np.empty((len(shapes), len(points)))
    for p, (placed, shape) in enumerate(zip(placements, shapes, strict=True)):
        distances[p] = signed_distance(shape, (points - placed[:3, 3]) @ placed[:3, :3])[0]
    order = np.sort(distances, axis=0)
    lead = order[1] - order[0] if len(shapes) > 1 else np.full(len(points), np.inf)
    part = distances.argmin(axis=0)
    return part, distances[part, np.arange(len(points))], lead
