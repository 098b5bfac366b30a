"""Meshes as kernels take them, and their motion with the parts of a body."""

from __future__ import annotations

from typing import NamedTuple

from tracker.foundation.arrays import Array32, Integers


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
