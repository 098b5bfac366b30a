"""Meshes as kernels take them, and their motion with the parts of a body."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tracker.arrays import Array, Array32, Integers
from tracker.kernels.compilation import compiled


class Mesh(NamedTuple):
    """Triangles that move with the parts of a scene; what is seen of all persons in one value."""

    points: Array32
    """(N, 3) vertices in the pose that the surface was measured in, metres."""

    normals: Array32
    """(N, 3) unit normals of the surface there, outwards."""

    bones: Integers
    """(N, K) scene-wide parts that move a vertex, the strongest first."""

    weights: Array32
    """(N, K) how much each of them does; they add up to 1."""

    faces: Integers
    """(T, 3) vertex numbers, anticlockwise seen from outside."""

    parts: Integers
    """(T,) scene-wide part that a face belongs to."""

    borders: Integers
    """(E, 4) edges of a single face: both ends, the third corner of the face, and the face."""

    n_traced: int
    """So many faces, the first ones, have contours; the others only hide what is behind them."""

    n_parts: int
    """Parts of the scene."""


@compiled(fastmath={"contract", "nsz"})
def pose_mesh(mesh: Mesh, motions: Array32, points: Array32, normals: Array32) -> None:
    """Linear blend skinning: ``x(q) = sum_k w_k M_k(q) x``, and the same without translations for normals.

    Args:
        mesh: the mesh.
        motions: (P, 3, 4) of each part, from the pose that it was measured in to the one wanted.
        points: (N, 3) output, world, metres.
        normals: (N, 3) output; not of unit length where motions differ.
    """
    for i in range(len(mesh.points)):
        x, y, z = mesh.points[i, 0], mesh.points[i, 1], mesh.points[i, 2]
        a, b, c = mesh.normals[i, 0], mesh.normals[i, 1], mesh.normals[i, 2]
        for j in range(3):
            place = turn = np.float32(0.0)
            for k in range(mesh.bones.shape[1]):
                w = mesh.weights[i, k]
                if w <= 0.0:
                    break
                p = mesh.bones[i, k]
                m0, m1, m2 = motions[p, j, 0], motions[p, j, 1], motions[p, j, 2]
                place += w * (m0 * x + m1 * y + m2 * z + motions[p, j, 3])
                turn += w * (m0 * a + m1 * b + m2 * c)
            points[i, j], normals[i, j] = place, turn


@compiled
def motions_of(placements: Array, b: int, part_from_rest: Array, motions: Array32) -> None:
    """Motions (P, 3, 4) of all parts from the pose that their surface was measured in.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres.
        b: which pose.
        part_from_rest: (P, 4, 4) from the pose that the surface was measured in.
        motions: output.
    """
    for p in range(placements.shape[1]):
        for i in range(3):
            for j in range(4):
                total = 0.0
                for k in range(4):
                    total += placements[b, p, i, k] * part_from_rest[p, k, j]
                motions[p, i, j] = total
