"""Where a standing person is, from a silhouette: facing the camera or turned aside."""

from __future__ import annotations

from itertools import product

import numpy as np

from tracker.acquisition.pictures import Silhouette
from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Person, Scene
from tracker.cameras.rig import Rig
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.measures.comparison import Comparison
from tracker.foundation.arrays import Array, Mask
from tracker.images.observation import Observation
from tracker.synthesis import Synthesis
from tracker.tracking.objective import Objective

# Poses at a time: bounds the memory.
_BATCH = 128


def scene_of(body: BodyModel, q: Array, silhouette: Silhouette) -> Scene:
    """The body alone before the camera of a picture."""
    return Scene((Person("subject", body, q),), Rig((silhouette.camera,)))


def placed(body: BodyModel, q: Array, silhouette: Silhouette, turn: float, synthesis: Synthesis) -> Array:
    """The pose (dof,) turned, and moved until it covers the silhouette's place and, in perspective, height.

    Args:
        body: the body.
        q: (dof,) joint angles; its root is overwritten.
        silhouette: the picture.
        turn: 0 faces the camera, pi / 2 shows the right side, rad.
        synthesis: makes the model's silhouette.
    """
    root, camera = body.root, silhouette.camera
    q = np.array(q)
    q[root.columns] = body.rest()[root.columns]
    towards = -camera.rays(np.array([(camera.size[0] - 1) / 2, (camera.size[1] - 1) / 2]))
    q[root.turn] = np.arctan2(towards[1], towards[0]) + turn
    size = body.stature_m
    x, y, width, height = silhouette.box
    depth = camera.matrix[1, 1] * size / height
    centre = camera.centre + depth * camera.rays(np.array([x + width / 2, y + height / 2]))
    q[root.shifts] = centre
    for _ in range(4):
        shown = synthesis.silhouettes(scene_of(body, q, silhouette))[0]
        if not shown.any():
            break
        if not silhouette.orthographic:
            ratio = _extent(shown)[2] / _extent(silhouette.mask)[2]
            q[root.shifts] = camera.centre + ratio * (q[root.shifts] - camera.centre)
            shown = synthesis.silhouettes(scene_of(body, q, silhouette))[0]
        gap = np.subtract(_extent(silhouette.mask)[:2], _extent(shown)[:2])
        depth = float(camera.in_camera(q[root.shifts])[2])
        right, down = camera.camera_from_world[0, :3], camera.camera_from_world[1, :3]
        q[root.shifts] += depth * (gap[0] / camera.matrix[0, 0] * right + gap[1] / camera.matrix[1, 1] * down)
    return q


def _extent(mask: Mask) -> tuple[float, float, float]:
    """Middle column of the trunk, middle row, and height, px."""
    rows, columns = np.nonzero(mask)
    return float(np.median(columns)), (rows.min() + rows.max()) / 2, float(rows.max() - rows.min() + 1)


def best_pose(
    body: BodyModel,
    q: Array,
    seen: tuple[Silhouette, Observation],
    values: dict[tuple[int, ...], Array],
    synthesis: Synthesis,
) -> tuple[Array, float]:
    """The pose (dof,) of all combinations of angles whose contours are nearest to the outline, and its distance, px.

    Args:
        body: the body.
        q: (dof,) where it stands.
        seen: picture and outline.
        values: columns of the pose, and the angles to try there, rad.
        synthesis: makes the model's contours.
    """
    asked = Comparison(scene_of(body, q, seen[0]), 0, synthesis, seen[1])
    objective = Objective(asked, ContourEvidence())
    poses = []
    for angles in product(*values.values()):
        pose = q.copy()
        for columns, angle in zip(values, angles, strict=True):
            pose[list(columns)] = angle
        poses.append(body.clamped(pose))
    distances = np.concatenate([objective(np.array(poses[i : i + _BATCH])) for i in range(0, len(poses), _BATCH)])
    best = int(np.argmin(distances))
    return poses[best], float(distances[best])
