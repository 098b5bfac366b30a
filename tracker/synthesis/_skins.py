"""Contours and pictures of persons with known surfaces, among others with parts alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.bodies.contours import Contours, gathered
from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array, Array32, Integers, Mask, frozen
from tracker.foundation.geometry.superquadrics import meshes_of
from tracker.kernels.contours import moving_parts
from tracker.kernels.pictures import draw_nearest, project_surfaces, rasterize
from tracker.kernels.skins import Mesh, fill_mesh, trace_skins
from tracker.synthesis._pictures import NEAREST_M

# Cells of a depth picture along the longer side of an image: 3 px of 720, 1 cm at a person who fills the picture. Half
# of a pose's time goes into drawing them; with 320 it is a sixth more, for the same agreement with rasterization.
_N_CELLS = 240.0

# Of parts that only hide what is behind them.
_GRID = (13, 24)

_SAMPLES = 768
"""Room for samples of a person in a view; twice as much where it does not do."""


def skinned_parts(scene: Scene) -> Mask:
    """(P,) parts of persons whose own surface is known."""
    flags = [np.full(len(person.body.parts), person.body.skin is not None) for person in scene.persons]
    found: Mask = np.concatenate(flags)
    return found


def with_skins(contours: Contours | None, scene: Scene, placements: Array, spacing: tuple[float, float]) -> Contours:
    """Contours of the parts with those of persons who have a skin replaced by that.

    Args:
        contours: of the parts; None where nobody is without a skin.
        scene: persons and rig.
        placements: (B, P, 4, 4) world_from_part, metres.
        spacing: contour a sample stands for, px; distance at which surfaces touch, metres.
    """
    mesh, part_from_rest = scene_mesh(scene)
    capacity = _SAMPLES * len(scene.persons)
    found = _traced(scene, placements, (mesh, part_from_rest), spacing, capacity)
    while int(found.counts.max(initial=0)) == found.parts.shape[2]:
        found = _traced(scene, placements, (mesh, part_from_rest), spacing, 2 * found.parts.shape[2])
    if contours is None:
        return found
    bare = ~skinned_parts(scene)[np.where(contours.valid, contours.parts, 0)]
    return gathered((contours, found), (bare, found.valid))


def _traced(
    scene: Scene, placements: Array, surface: tuple[Mesh, Array], spacing: tuple[float, float], capacity: int
) -> Contours:
    mesh, part_from_rest = surface
    layout = (len(placements), len(scene.rig), capacity)
    positions, points = np.empty((*layout, 5), dtype=np.float32), np.empty((*layout, 3), dtype=np.float32)
    parts, between = np.empty(layout, dtype=np.int64), np.empty(layout, dtype=np.bool_)
    counts = np.zeros(layout[:2], dtype=np.int64)
    rig, rule = scene.rig, (spacing[0], spacing[1], _N_CELLS)
    trace_skins(
        placements, part_from_rest, mesh, rig.packed, rig.sizes, rule, positions, points, parts, between, counts
    )
    return Contours(positions, points, parts, between, counts)


def fill_skins(scene: Scene, masks: tuple[Mask, ...]) -> None:
    """Sets the pixels of all views that skins cover."""
    placements, first = scene.world_from_parts()[0], 0
    for person in scene.persons:
        body, behind = person.body, first + len(person.body.parts)
        if body.skin is not None:
            points = body.skin.world_points(placements[first:behind])
            for row, mask in zip(scene.rig.packed, masks, strict=True):
                fill_mesh(points, body.skin.faces, row, mask)
        first = behind


def ids_of_skins(scene: Scene) -> tuple[Integers, ...]:
    """Scene-wide part number (H, W) seen at each pixel's centre in every view, -1 for none, by rasterization."""
    mesh, part_from_rest = scene_mesh(scene)
    motions = (scene.world_from_parts()[0] @ part_from_rest)[mesh.bones, :3]
    blended = (mesh.weights[..., None, None] * motions).sum(axis=1)
    points = np.einsum("nij,nj->ni", blended[..., :3], mesh.points) + blended[..., 3]
    found = []
    for camera in scene.rig.cameras:
        depths = camera.in_camera(points)[:, 2]
        before = (depths[mesh.faces] > NEAREST_M).all(axis=1)
        buffers = np.zeros((*camera.size[::-1], 4), dtype=np.float32)
        rasterize(camera.project(points), depths, np.ascontiguousarray(mesh.faces[before]), (0, 0), buffers)
        owners = np.append(mesh.parts[before], -1)
        found.append(np.where(buffers[..., 0] > 0, owners[buffers[..., 1].astype(np.int64)], -1))
    return tuple(found)


def scene_mesh(scene: Scene) -> tuple[Mesh, Array]:
    """All that can be seen, persons with a skin first, and where its parts were measured (P, 4, 4)."""
    meshes, rests = [], []
    first = 0
    for person in scene.persons:
        body, n_parts = person.body, len(person.body.parts)
        if body.skin is not None:
            bones, weights = body.skin.bones
            skin = body.skin
            mesh = Mesh(
                frozen(skin.points, np.float32),
                skin.normals,
                bones,
                weights,
                skin.faces,
                skin.face_parts,
                skin.borders,
                len(skin.faces),
                n_parts,
            )
            rests.append(skin.part_from_rest)
        else:
            mesh = _parts_mesh(body.shapes)
            rests.append(np.broadcast_to(np.eye(4), (n_parts, 4, 4)))
        meshes.append((first, mesh))
        first += n_parts
    meshes.sort(key=lambda pair: pair[1].n_traced == 0)
    return _merged(meshes, first), frozen(np.concatenate(rests))


def _parts_mesh(shapes: Array) -> Mesh:
    """Superquadrics (P, 7) as a mesh that has no contours of its own."""
    grids = meshes_of(shapes, *_GRID)
    n_parts, n_points = grids.points.shape[:2]
    n_faces = len(grids.triangles)
    bones = np.arange(n_parts).repeat(n_points)[:, None]
    faces = (grids.triangles + n_points * np.arange(n_parts)[:, None, None]).reshape(-1, 3)
    return Mesh(
        frozen(grids.points.reshape(-1, 3), np.float32),
        frozen(grids.normals.reshape(-1, 3), np.float32),
        frozen(bones, np.int64),
        frozen(np.ones((len(bones), 1)), np.float32),
        frozen(faces, np.int64),
        frozen(np.arange(n_parts).repeat(n_faces), np.int64),
        frozen(np.zeros((0, 4)), np.int64),
        0,
        n_parts,
    )


def _merged(meshes: list[tuple[int, Mesh]], n_parts: int) -> Mesh:
    """Meshes as one, with the number of the first part of each."""
    if len(meshes) == 1:
        return meshes[0][1]
    n_bones = max(mesh.bones.shape[1] for _, mesh in meshes)
    vertices = np.cumsum([0, *(len(mesh.points) for _, mesh in meshes)])
    faces = np.cumsum([0, *(len(mesh.faces) for _, mesh in meshes)])

    def wide(values: NDArray[Any]) -> NDArray[Any]:
        return np.pad(values, ((0, 0), (0, n_bones - values.shape[1])))

    pairs = list(zip(meshes, vertices.tolist(), faces.tolist(), strict=False))
    return Mesh(
        frozen(np.concatenate([mesh.points for _, mesh in meshes]), np.float32),
        frozen(np.concatenate([mesh.normals for _, mesh in meshes]), np.float32),
        frozen(np.concatenate([wide(mesh.bones + first) for first, mesh in meshes]), np.int64),
        frozen(np.concatenate([wide(mesh.weights) for _, mesh in meshes]), np.float32),
        frozen(np.concatenate([mesh.faces + start for (_, mesh), start, _ in pairs]), np.int64),
        frozen(np.concatenate([mesh.parts + first for first, mesh in meshes]), np.int64),
        frozen(np.concatenate([mesh.borders + np.array([at, at, at, f]) for (_, mesh), at, f in pairs]), np.int64),
        sum(mesh.n_traced for _, mesh in meshes),
        n_parts,
    )


# The part at each pixel in many poses of a person, with unmoved parts drawn once.

PartIds = NDArray[np.int16]
"""(H, W) scene-wide part number seen at each pixel's centre, -1 for none."""


@dataclass(frozen=True)
class _Drawn:
    """What views show of some parts."""

    depths: tuple[Array32, ...]
    """(H, W) of each view: inverse depths, 1 / m, 0 where there is nothing."""

    ids: tuple[PartIds, ...]


def ids_of_poses(
    scene: Scene, person: int | None, poses: Array | None, n_eta: int, n_omega: int
) -> Iterator[tuple[PartIds, ...]]:
    """The nearest part at every pixel of all views, pose after pose.

    The same as `rasterized_ids`, in a third of the time where all parts move and in a fifteenth where a limb does
    (`benchmark.py starts`): sides that face the camera alone are drawn, row by row, and of a batch only what moves. If
    a person's own surface is known, it is rasterized pose by pose.

    Args:
        scene: persons and rig.
        person: whose poses are given; None for the scene as it is.
        poses: (B, dof) rad and metres; None for the scene as it is.
        n_eta, n_omega: latitudes and longitudes of the parts' meshes.
    """
    if scene.has_skins:
        posed = [scene] if person is None or poses is None else (scene.with_pose(person, q) for q in poses)
        yield from (tuple(view.astype(np.int16) for view in ids_of_skins(one)) for one in posed)
        return
    placements = scene.world_from_parts(person, poses)
    moving = moving_parts(placements)
    empty = _Drawn(
        tuple(np.zeros(camera.size[::-1], dtype=np.float32) for camera in scene.rig.cameras),
        tuple(np.full(camera.size[::-1], -1, dtype=np.int16) for camera in scene.rig.cameras),
    )
    still = _with_parts(empty, scene, placements[0], ~moving, (n_eta, n_omega)) if len(placements) else empty
    for placed in placements:
        yield _with_parts(still, scene, placed, moving, (n_eta, n_omega)).ids


def _with_parts(drawn: _Drawn, scene: Scene, placements: Array, wanted: Mask, grid: tuple[int, int]) -> _Drawn:
    """The same with some parts (P,), placed at (P, 4, 4), drawn as well."""
    meshes = meshes_of(scene.shapes, *grid)
    seen = np.empty((len(scene.shapes), 3, meshes.points.shape[1]))
    after = _Drawn(tuple(view.copy() for view in drawn.depths), tuple(view.copy() for view in drawn.ids))
    for row, depths, ids in zip(scene.rig.packed, after.depths, after.ids, strict=True):
        project_surfaces(placements, meshes.points, wanted, row, seen)
        draw_nearest(seen, meshes.triangles, (0, 0), depths, ids)
    return after
