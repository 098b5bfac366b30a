"""Furniture in the empty rooms of recordings: cupboards before persons, a chair below them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from tracker.bodies.body import BodyModel
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Array32, Image
from tracker.kernels.pictures import rasterize

# From the nearest place of a person's middle to that of a cupboard, and from a sitting person's hips to the backrest.
_CUPBOARD_AWAY_M, _BACKREST_AWAY_M = 1.0, 0.24
# BGR, and how light faces are: to the four sides, above and below.
_WOOD, _SHADES = (70, 105, 140), (0.9, 0.75, 0.95, 0.8, 1.15, 0.5)
_SIDES = np.array([(1.0, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)])


@dataclass(frozen=True)
class Box:
    """A board, a leg or a cupboard, upright."""

    middle: tuple[float, float, float]
    """In the world, metres."""

    heading: float
    """Direction of its depth, rad from the x axis."""

    depth_m: float
    width_m: float
    height_m: float

    @property
    def mesh(self) -> trimesh.Trimesh:
        """In the world."""
        placed = np.eye(4)
        placed[:3, :3] = Rotation.from_euler("z", self.heading).as_matrix()
        placed[:3, 3] = self.middle
        mesh: trimesh.Trimesh = trimesh.creation.box((self.depth_m, self.width_m, self.height_m), placed)
        return mesh


def cupboards(rig: Rig, n: int, places: Array) -> list[Box]:
    """One each between a person who is at places (T, 2) and the first cameras."""
    middle = (places.min(axis=0) + places.max(axis=0)) / 2
    found = []
    for camera in rig.cameras[:n]:
        way = camera.centre[:2] - middle
        way /= np.linalg.norm(way)
        x, y = middle + (((places - middle) @ way).max() + _CUPBOARD_AWAY_M) * way
        found.append(Box((x, y, 0.55), float(np.arctan2(way[1], way[0])), 0.4, 1.2, 1.1))
    return found


def chair(hips: Array, heading: float, seat_m: float) -> list[Box]:
    """A chair on which somebody sits.

    Args:
        hips: (2,) where the middle of the hips is, metres.
        heading: where the person faces, rad from the x axis.
        seat_m: height of the seat above the floor, metres.
    """
    ahead = np.array([np.cos(heading), np.sin(heading)])
    aside = np.array([-ahead[1], ahead[0]])

    def at(forward_m: float, sideways_m: float, height_m: float, size: tuple[float, float, float]) -> Box:
        x, y = hips + forward_m * ahead + sideways_m * aside
        return Box((x, y, height_m), heading, *size)

    legs = [
        at(forward_m, sideways_m, (seat_m - 0.04) / 2, (0.04, 0.04, seat_m - 0.04))
        for forward_m in (0.02 - _BACKREST_AWAY_M, 0.20)
        for sideways_m in (-0.2, 0.2)
    ]
    seat = at(0.0, 0.0, seat_m - 0.02, (2 * _BACKREST_AWAY_M, 0.44, 0.04))
    backrest = at(-_BACKREST_AWAY_M, 0.0, seat_m + 0.24, (0.03, 0.44, 0.44))
    return [*legs, seat, backrest]


def chair_below(body: BodyModel, q: Array) -> list[Box]:
    """The chair on which a body with a skin sits at a pose (dof,): its thighs lie on the seat."""
    assert body.skin is not None
    names = [part.name for part in body.parts]
    placed = body.world_from_part(q)
    pelvis = placed[names.index("pelvis")]
    sits = np.isin(body.skin.labels, [names.index(name) for name in ("pelvis", "left_thigh", "right_thigh")])
    seat_m = float(body.skin.world_points(placed)[sits, 2].min())
    return chair(pelvis[:2, 3], float(np.arctan2(pelvis[1, 0], pelvis[0, 0])), seat_m)


def furnished(pictures: list[Image], rig: Rig, boxes: list[Box]) -> tuple[list[Image], tuple[Array32, ...]]:
    """The pictures of the room with boxes in it, and how far (h, w) each pixel's box is, see `Simulation.away_m`."""
    if not boxes:
        return pictures, ()
    mesh = trimesh.util.concatenate([box.mesh for box in boxes])
    assert isinstance(mesh, trimesh.Trimesh)
    found = [_drawn(picture, camera, mesh) for picture, camera in zip(pictures, rig.cameras, strict=True)]
    return [picture for picture, _ in found], tuple(away for _, away in found)


def _drawn(picture: Image, camera: Camera, mesh: trimesh.Trimesh) -> tuple[Image, Array32]:
    corners = np.asarray(mesh.vertices, dtype=np.float64)
    depths = camera.in_camera(corners)[:, 2]
    triangles = np.asarray(mesh.faces, dtype=np.int64)
    before = triangles[(depths[triangles] > 0.1).all(axis=1)]
    buffers = np.zeros((*picture.shape[:2], 4), dtype=np.float32)
    rasterize(camera.project(corners), depths, before, (0, 0), buffers)
    covered = buffers[..., 0] > 0
    sides = (np.asarray(mesh.face_normals) @ _SIDES.T).argmax(axis=1)
    shades = np.array(_SHADES)[sides][(depths[triangles] > 0.1).all(axis=1)]
    shown, away = picture.copy(), np.full(picture.shape[:2], np.inf, dtype=np.float32)
    shown[covered] = shades[buffers[..., 1][covered].astype(np.int64)][:, None] * np.array(_WOOD)
    away[covered] = 1 / buffers[..., 0][covered]
    return shown, away
