"""Skins: a body's own surface as a triangle mesh that moves with its parts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tracker.foundation.arrays import Array, Array32, Integers, frozen, shape_fault
from tracker.foundation.errors import ModelError

MOST_BONES = 4
"""Parts that move one vertex; in scans of two dressed persons none has more with over 1 % each."""


@dataclass(frozen=True)
class Skin:
    """A triangle mesh, also of several open patches, and how much each part of the body moves its vertices.

    Smooth skinning blends the motions of several parts (`world_points`); with one part a vertex it is rigid.

    Raises:
        ModelError: numbers out of range, weights that are none, triangles that do not exist.
    """

    points: Array
    """(N, 3) vertices in the pose that the surface was measured in, metres, in the body's model frame."""

    faces: Integers
    """(T, 3) vertex numbers, anticlockwise seen from outside."""

    weights: Array
    """(N, P) how much each part of the body moves a vertex, not negative; scaled so that they add up to 1."""

    part_from_rest: Array
    """(P, 4, 4) of each part, from the pose that the surface was measured in."""

    def __post_init__(self) -> None:
        points, faces, weights = frozen(self.points), frozen(self.faces, np.int64), frozen(self.weights)
        if fault := shape_fault(points, None, 3) or shape_fault(weights, len(points), len(self.part_from_rest)):
            raise ModelError(f"skin: {fault}")
        if fault := shape_fault(faces, None, 3):
            raise ModelError(f"skin: triangles: {fault}")
        if not len(faces) or faces.min() < 0 or faces.max() >= len(points):
            raise ModelError(f"skin: {len(faces)} triangles of {len(points)} vertices, expected vertices that exist")
        if not np.isfinite(points).all() or not np.isfinite(weights).all() or weights.min() < 0:
            raise ModelError("skin: vertices and weights must be finite, and no weight negative")
        bare = np.flatnonzero(weights.sum(axis=1) <= 0)
        if len(bare):
            raise ModelError(f"skin: {len(bare)} vertices that no part moves, the first is number {bare[0]}")
        values = points, faces, frozen(_strongest(weights)), frozen(self.part_from_rest)
        for name, value in zip(("points", "faces", "weights", "part_from_rest"), values, strict=True):
            object.__setattr__(self, name, value)

    @cached_property
    def labels(self) -> Integers:
        """(N,) the part that moves each vertex most."""
        strongest: Integers = frozen(self.weights.argmax(axis=1), np.int64)
        return strongest

    @cached_property
    def face_parts(self) -> Integers:
        """(T,) the part of most corners of a face; of three different ones that of the first."""
        a, b, c = self.labels[self.faces].T
        found: Integers = frozen(np.where(b == c, b, a), np.int64)
        return found

    @cached_property
    def bones(self) -> tuple[Integers, Array32]:
        """Parts (N, K) that move each vertex, the strongest first, and their weights (N, K)."""
        n_bones = max(1, int((self.weights > 0).sum(axis=1).max()))
        order = np.argsort(-self.weights, axis=1, kind="stable")[:, :n_bones]
        return frozen(order, np.int64), frozen(np.take_along_axis(self.weights, order, axis=1), np.float32)

    @cached_property
    def normals(self) -> Array32:
        """(N, 3) unit normals of the vertices, those of the faces weighed by the angle in the corner.

        Vertices in one place are taken for one: patches that were cut from one another stay smooth.
        """
        corners = self.points[self.faces]
        ways = [corners[:, (k + 1) % 3] - corners[:, k] for k in range(3)]
        across = np.cross(ways[0], -ways[2])
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
        _, places = np.unique(np.round(self.points, 6), axis=0, return_inverse=True)
        sums = np.zeros((places.max() + 1, 3))
        for k in range(3):
            one, other = ways[k], -ways[(k + 2) % 3]
            lengths = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
            cosine = (one * other).sum(axis=1) / np.maximum(lengths, 1e-12)
            angles = np.arccos(np.clip(cosine, -1, 1))
            np.add.at(sums, places.ravel()[self.faces[:, k]], angles[:, None] * across)
        found = sums[places.ravel()]
        unit: Array32 = frozen(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-12), np.float32)
        return unit

    @cached_property
    def borders(self) -> Integers:
        """(E, 4) edges of a single face: both ends, the third corner of the face, and the face."""
        n_faces = len(self.faces)
        edges = np.concatenate([self.faces[:, [k, (k + 1) % 3, (k + 2) % 3]] for k in range(3)])
        _, places = np.unique(np.round(self.points, 6), axis=0, return_inverse=True)
        ends = np.sort(places.ravel()[edges[:, :2]], axis=1)
        _, first, counts = np.unique(ends, axis=0, return_index=True, return_counts=True)
        single = first[counts == 1]
        found: Integers = frozen(np.column_stack([edges[single], single % n_faces]), np.int64)
        return found

    def world_points(self, world_from_part: Array) -> Array:
        """Vertices (*B, N, 3) in the world of parts placed at (*B, P, 4, 4), metres: linear blend skinning."""
        motions = world_from_part @ self.part_from_rest
        blended = np.einsum("np,...pij->...nij", self.weights, motions[..., :3, :])
        moved: Array = np.einsum("...nij,nj->...ni", blended[..., :3], self.points) + blended[..., 3]
        return moved


def _strongest(weights: Array) -> Array:
    """The weights (N, P) with all but the `MOST_BONES` largest of each vertex left out, adding up to 1."""
    kept = weights.copy()
    if kept.shape[1] > MOST_BONES:
        weakest = np.argsort(-kept, axis=1, kind="stable")[:, MOST_BONES:]
        np.put_along_axis(kept, weakest, 0.0, axis=1)
    total: Array = kept / kept.sum(axis=1, keepdims=True)
    return total
