"""One person in one view: edges seen, and the equations that draw the contours to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.bodies.scene import Scene
from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.measures.comparison import Comparison
from tracker.evidence.measures.correspondences import correspondences
from tracker.foundation.arrays import Array
from tracker.images.observation import Observation
from tracker.images.sight import Sight
from tracker.results.alignment.moments import Moment
from tracker.synthesis.cpu import CpuSynthesis

_DIRECTION_DEG = 25.0
"""Largest angle between a contour and the edge it is paired with: a pose that was tracked has the right ones."""

POSE_SPREAD = np.radians(10.0), 0.1
"""Standard deviation of angles, rad, and translations, m, around the pose that was tracked: a compromise between views
as far apart as persons moved meanwhile. Of 5 degrees and 10 the same came out, to 0.2 mm."""


@dataclass(frozen=True)
class Look:
    """What one view shows of one person."""

    view: int
    scene: Scene
    """All persons, and this view's camera alone."""

    person: int
    observed: Observation

    def rows(self, q: Array, gate_px: float) -> tuple[Array, Array, Array, Array]:
        """Pairs of contour and edge, linearized in the pose (dof,) and in a turn of the camera.

        Returns:
            Residuals (N,) px, their derivatives by the pose (N, dof) and by the turn (N, 3) px/rad, weights (N,): how
            many observations each stands for, robustly (Geman & McClure).
        """
        scene = self.scene.with_pose(self.person, q)
        asked = Comparison(scene, self.person, CpuSynthesis(), self.observed)
        pairs = correspondences(asked, q, gate_px, _DIRECTION_DEG)
        residuals, jacobian = pairs.residual(asked.body, q, scene.rig)
        turned = by_turn(scene.rig.cameras[0], pairs.points, pairs.normals)
        weights = pairs.weights / (1 + (residuals / (0.5 * gate_px)) ** 2) ** 2
        known = np.isfinite(residuals)
        return residuals[known], jacobian[known], turned[known], weights[known]

    def by(self, rig: Rig) -> Look:
        """The same look with another rig's camera."""
        return Look(self.view, Scene(self.scene.persons, _alone(rig, self.view)), self.person, self.observed)


def looks_of(moment: Moment) -> list[Look]:
    """What each view that has an image shows of the person."""
    found = []
    for v, image in enumerate(moment.frame.images):
        if image is not None:
            scene = Scene(moment.scene.persons, _alone(moment.scene.rig, v))
            expected = CpuSynthesis().contours(scene)
            sight = Sight(Frame(moment.frame.index, moment.frame.time_s, (image,)))
            found.append(Look(v, scene, moment.person, ContourEvidence().observe(sight, expected)))
    return found


def by_turn(camera: Camera, points: Array, normals: Array) -> Array:
    """(N, 3) by how much points (N, 3) move along image normals (N, 2) as a camera turns in its place, px/rad.

    A rotation vector in camera coordinates moves a point there by its cross product with the point.
    """
    along = np.einsum("ni,nij->nj", normals, camera.project_jacobian(points)) @ camera.camera_from_world[:3, :3].T
    return np.asarray(np.cross(camera.in_camera(points), along))


def _alone(rig: Rig, view: int) -> Rig:
    return Rig((rig.cameras[view],))
