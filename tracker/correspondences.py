"""Oriented correspondences between model contours and scene edges, and the residual they leave."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.arrays import Array, Integers
from tracker.body import BodyModel
from tracker.rig import Rig


@dataclass(frozen=True)
class Correspondences:
    """N pairs of a model contour point and the scene edge point it should lie on."""

    points: Array
    """(N, 3) model points in the world at the pose they were made at, metres."""

    parameters: Integers
    """(N,) last pose parameter that moves each point."""

    views: Integers
    """(N,) view of the pair."""

    normals: Array
    """(N, 2) unit image normal of the model contour."""

    pixels: Array
    """(N, 2) scene edge point, px."""

    weights: Array
    """(N,) weight of the squared residual."""

    def residual(self, body: BodyModel, q: Array, rig: Rig) -> tuple[Array, Array]:
        """Distance from model point to scene edge along the contour's normal, linear in the pose.

        Args:
            body: the model whose pose is sought.
            q: (dof,) the pose the points were made at.
            rig: the V cameras.

        Returns:
            Residual (N,) px and its Jacobian (N, dof) px per rad or metre.
        """
        motion = body.point_jacobian(q, self.points, self.parameters)
        residual = np.zeros(len(self.points))
        jacobian = np.zeros((len(self.points), body.dof))
        for v, camera in enumerate(rig.cameras):
            rows = np.flatnonzero(self.views == v)
            points, normals = self.points[rows], self.normals[rows]
            residual[rows] = ((camera.project(points) - self.pixels[rows]) * normals).sum(axis=1)
            across = np.einsum("ni,nij->nj", normals, camera.project_jacobian(points))
            jacobian[rows] = np.einsum("nj,njd->nd", across, motion[rows])
        return residual, jacobian
