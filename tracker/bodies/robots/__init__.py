"""Robots and animals as descriptions for simulators: a tree of links, joints with limits, visible shapes."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.bodies.skin import ScannedSurface
from tracker.foundation.arrays import Array
from tracker.foundation.errors import ModelError
from tracker.foundation.source_files import content_of, one_line


@dataclass(frozen=True)
class Joint:
    """One degree of freedom, with all joints at zero."""

    name: str
    rotates: bool
    axis: Array
    """(3,) unit vector in the world."""

    point: Array
    """(3,) on the axis, in the world, metres."""

    limits: tuple[float, float]
    """rad or m; infinite where free."""


@dataclass(frozen=True)
class Link:
    """One moving piece: a link with those that are fixed to it."""

    name: str
    parent: int
    """Number of its parent link, always a smaller one; -1 for the base or the world."""

    joints: tuple[Joint, ...]
    """Outermost first, one at least."""

    surface: ScannedSurface | None
    """Its visible surface, in the world, with all joints at zero; None for none."""


@dataclass(frozen=True)
class Robot:
    """A robot with all of its joints at zero."""

    name: str
    base: str
    """Name of the link that carries all others."""

    base_point: Array
    """(3,) origin of that link's frame, in the world, metres."""

    free: bool
    """Whether the description says that the base moves about."""

    base_surface: ScannedSurface | None
    links: tuple[Link, ...]
    """Parents first."""

    unread: tuple[str, ...]
    """Parts of the description that differ here, or are missing, a sentence each."""


_FREE_LIMIT = 200 * np.pi
"""Of a joint that turns without end, rad."""


@dataclass(frozen=True)
class NestedJoint:
    """A joint in the frame of the link that it moves."""

    name: str
    rotates: bool
    axis: Array
    point: Array = field(default_factory=lambda: np.zeros(3))
    limits: tuple[float, float] = (-_FREE_LIMIT, _FREE_LIMIT)


@dataclass(frozen=True)
class Nested:
    """A link in the frame of its parent."""

    name: str
    parent: str
    """Empty for the world."""

    placement: Array
    """(4, 4) of its frame in that of its parent, where the joints are zero."""

    joints: tuple[NestedJoint, ...] = ()
    surfaces: tuple[ScannedSurface, ...] = ()
    """In its frame, metres."""


def placed(xyz: Sequence[float] | Array, rotation: Rotation) -> Array:
    """(4, 4) of a place and a rotation."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation.as_matrix(), xyz
    return matrix


def moved(surface: ScannedSurface, placement: Array) -> ScannedSurface:
    """A surface in another frame."""
    return ScannedSurface(surface.points @ placement[:3, :3].T + placement[:3, 3], surface.faces)


def joined(surfaces: Sequence[ScannedSurface]) -> ScannedSurface | None:
    """Several surfaces as one; None for none."""
    if not surfaces:
        return None
    firsts = np.cumsum([0, *(len(one.points) for one in surfaces[:-1])])
    faces = np.concatenate([one.faces + first for one, first in zip(surfaces, firsts, strict=True)])
    return ScannedSurface(np.concatenate([one.points for one in surfaces]), faces)


def assembled(name: str, nested: Sequence[Nested], free: bool, unread: Sequence[str]) -> Robot:
    """The robot of links, parents first; links without joints belong to their parents."""
    frames: dict[str, Array] = {"": np.eye(4)}
    owners: dict[str, int] = {"": -1}
    surfaces: dict[int, list[ScannedSurface]] = {-1: []}
    moving: list[tuple[Nested, int, Array]] = []
    for link in nested:
        frames[link.name] = frames[link.parent] @ link.placement
        owner = owners[link.parent]
        if link.joints:
            moving.append((link, owner, frames[link.name]))
            owner = len(moving) - 1
        owners[link.name] = owner
        surfaces.setdefault(owner, []).extend(moved(one, frames[link.name]) for one in link.surfaces)
    links = tuple(
        Link(link.name, parent, tuple(_in_world(joint, frame) for joint in link.joints), joined(surfaces.get(k, [])))
        for k, (link, parent, frame) in enumerate(moving)
    )
    base = next((link.name for link in nested if owners[link.name] == -1), "base")
    point = frames.get(base, np.eye(4))[:3, 3]
    return Robot(name, base, point, free, joined(surfaces[-1]), links, tuple(unread))


def _in_world(joint: NestedJoint, frame: Array) -> Joint:
    axis = frame[:3, :3] @ (joint.axis / np.linalg.norm(joint.axis))
    return Joint(joint.name, joint.rotates, axis, frame[:3, :3] @ joint.point + frame[:3, 3], joint.limits)


def mimicking(names: Mapping[str, str]) -> list[str]:
    """Remarks about joints that follow others, each by the name of the one it follows."""
    return [f'joint "{name}" follows "{other}" there, here it moves by itself' for name, other in names.items()]


# Visible shapes of links as triangles: primitives, and meshes in files.

_AROUND = 24
"""Corners of what is round: a chord of 24 leaves 0.9 % of the radius."""

_MOST_FACES = 3000
"""Largest number of triangles of a mesh: visible meshes of robots have every screw, 100 000 triangles and more; see
`thinned`."""

_CELLS = 24
"""Cells along the longest side of a mesh that is thinned: a ball keeps 4600 triangles, none 0.3 % of its radius off."""

_LARGEST_BYTES = 2**28
"""Of a mesh file."""

KINDS = (".stl", ".obj", ".ply", ".dae", ".glb", ".gltf", ".off")
"""Files of meshes that are read; .dae needs the package pycollada."""


def box(half: Array) -> ScannedSurface:
    """A box of half extents (3,)."""
    return _from_trimesh(_trimesh().creation.box(extents=2 * np.asarray(half)))


def ellipsoid(half: Array) -> ScannedSurface:
    """An ellipsoid of half axes (3,)."""
    mesh = _trimesh().creation.uv_sphere(radius=1.0, count=[_AROUND // 2, _AROUND])
    return ScannedSurface(np.array(mesh.vertices) * half, np.array(mesh.faces, dtype=np.int64))


def cylinder(radius: float, length: float) -> ScannedSurface:
    """A cylinder along z about the origin."""
    return _from_trimesh(_trimesh().creation.cylinder(radius=radius, height=length, sections=_AROUND))


def capsule(radius: float, length: float) -> ScannedSurface:
    """A cylinder of that length with half balls at its ends, along z about the origin."""
    ball = ellipsoid(np.full(3, radius))
    points = ball.points + np.where(ball.points[:, 2:] >= 0, 1, -1) * np.array([0, 0, length / 2])
    return ScannedSurface(points, ball.faces)


def along(start: Array, end: Array) -> tuple[Array, Rotation, float]:
    """Middle, rotation from z, and length of a shape from one point to another."""
    way = np.asarray(end) - np.asarray(start)
    length = float(np.linalg.norm(way))
    if length == 0:
        raise ModelError("fromto: both ends are the same point")
    turn, _ = Rotation.align_vectors(way[None] / length, np.array([[0.0, 0.0, 1.0]]))
    return (np.asarray(start) + np.asarray(end)) / 2, turn, length


def read_mesh(path: Path, scale: Array) -> ScannedSurface:
    """Reads the triangles of a mesh file.

    Args:
        path: the file.
        scale: (3,) by which lengths are multiplied.

    Raises:
        ModelError: the file is missing or damaged, or of a kind that is not read.
    """
    kind = path.suffix.lower()
    if kind not in KINDS:
        raise ModelError(f"{path}: a mesh of the kind {kind or 'nothing'}, expected one of {', '.join(KINDS)}")
    content = content_of(path, ModelError, "the mesh", _LARGEST_BYTES)
    if content.startswith(b"version https://git-lfs"):
        raise ModelError(f"{path}: a pointer of Git LFS, no mesh: `git lfs pull` brings it")
    if kind == ".dae" and importlib.util.find_spec("collada") is None:
        raise ModelError(f"{path}: reading it needs the Python package pycollada: pip install pycollada")
    trimesh = _trimesh()
    try:
        mesh = trimesh.load_scene(str(path)).to_mesh()
        points, faces = np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64)
    except Exception as error:  # whatever a damaged file makes of the parser
        raise ModelError(f"{path}: damaged {kind} file, or no mesh of triangles: {one_line(error)}") from error
    if not len(faces) or not np.isfinite(points).all():
        raise ModelError(f"{path}: {len(faces)} triangles, expected a surface of finite points")
    if np.prod(scale) < 0:  # a mirrored mesh would be inside out
        faces = faces[:, ::-1]
    return thinned(ScannedSurface(points * scale, faces))


def thinned(surface: ScannedSurface) -> ScannedSurface:
    """A mesh with its corners in one cell of a grid taken together, if it has many triangles."""
    if len(surface.faces) <= _MOST_FACES:
        return surface
    low = surface.points.min(axis=0)
    cell = float(np.ptp(surface.points, axis=0).max()) / _CELLS
    _, numbers = np.unique(((surface.points - low) / cell).astype(np.int64), axis=0, return_inverse=True)
    numbers = numbers.ravel()
    counts = np.bincount(numbers)
    points = np.stack([np.bincount(numbers, surface.points[:, k]) / counts for k in range(3)], axis=1)
    faces = numbers[surface.faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return ScannedSurface(points, faces[np.sort(first)])


def _from_trimesh(mesh: Any) -> ScannedSurface:
    return ScannedSurface(np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64))


def _trimesh() -> Any:
    # a quarter of a second that other commands need not wait for
    return importlib.import_module("trimesh")
