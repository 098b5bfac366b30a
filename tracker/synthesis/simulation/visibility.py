"""How much of every segment each view shows: inside the picture, and not behind another part."""

from __future__ import annotations

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Scene
from tracker.bodies.segments import Part
from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array, Mask
from tracker.synthesis import Synthesis

_LONGEST_PX = 480
"""Longer side of the pictures in which visibility is looked up: a forearm is still some pixels wide."""

_FACING = 0.25
"""Cosine of the angle between a surface and the ray above which it faces the camera: the rim falls between pixels."""


def visible_shares(scene: Scene, poses: Array, synthesis: Synthesis) -> Array:
    """Shares of the surface of each part that a camera could see if nothing were before it or beyond the picture.

    Args:
        scene: one person, and the rig.
        poses: (B, dof).
        synthesis: says which part is seen at a pixel.

    Returns:
        (B, V, P) 0 to 1.
    """
    longest = max(max(camera.size) for camera in scene.rig.cameras)
    factor = max(1, round(longest / _LONGEST_PX))
    small = Scene(scene.persons, scene.rig.downscaled(factor) if factor > 1 else scene.rig)
    body = scene.persons[0].body
    shares = np.zeros((len(poses), len(small.rig), len(body.parts)))
    for b, q in enumerate(poses):
        pictures = synthesis.part_ids(small.with_pose(0, q))
        placements = body.world_from_part(q)
        for v, (camera, ids) in enumerate(zip(small.rig.cameras, pictures, strict=True)):
            for p, part in enumerate(body.parts):
                points, normals = _surface(part, placements[p])
                shares[b, v, p] = _share(camera, ids == p, points, normals)
    return shares


def _surface(part: Part, placement: Array) -> tuple[Array, Array]:
    """Points and unit normals (N, 3) spread over a part, in the world."""
    eta = np.linspace(-1.25, 1.25, 9)[:, None]
    omega = np.linspace(-np.pi, np.pi, 16, endpoint=False)[None, :]
    points, normals = part.shape.surface(eta, omega)
    turned = normals.reshape(-1, 3) @ placement[:3, :3].T
    return points.reshape(-1, 3) @ placement[:3, :3].T + placement[:3, 3], turned


def _share(camera: Camera, shown: Mask, points: Array, normals: Array) -> float:
    rays = points - camera.centre
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    facing = -(rays * normals).sum(axis=1) > _FACING
    if not facing.any():
        return 0.0
    pixels = camera.project(points[facing])
    height, width = shown.shape
    with np.errstate(invalid="ignore"):
        inside = ((pixels > -0.5) & (pixels < np.array([width, height]) - 0.5)).all(axis=1)
    inside &= camera.in_camera(points[facing])[:, 2] > 0
    columns, rows = np.round(pixels[inside]).astype(int).T
    return float(shown[rows, columns].sum()) / int(facing.sum())


def by_segment(body: BodyModel, shares: Array) -> dict[str, Array]:
    """Segment -> shares (B, V) of its parts, averaged by their length, from (B, V, P)."""
    found = {}
    lengths = np.array([float(part.shape.size.max()) for part in body.parts])
    for name in dict.fromkeys(part.segment for part in body.parts):
        chosen = [p for p, part in enumerate(body.parts) if part.segment == name]
        found[name] = np.average(shares[:, :, chosen], axis=2, weights=lengths[chosen])
    return found
