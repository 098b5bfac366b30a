"""Incidence of model points with the viewing rays of scene edges (Rosenhahn et al. 2006, section 2.3)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tracker.cameras.rig import Rig
from tracker.evidence.measures.correspondences import Correspondences, Equations, correspondences
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.similarity.chamfer import ChamferSimilarity
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component


@component
class PlueckerSimilarity:
    """Ranks poses as `chamfer` does; refines them by points on Pluecker lines.

    Each edge point is a ray ``L = (n, m)``, n its unit direction and ``m = c x n`` with the camera's place c, and the
    model point X that it is paired with must lie on it: ``X x n - m = 0`` (eqs. 10-12; two independent equations a
    pair). `chamfer` only minimizes the distance along the normal of the contour. This measure holds points along the
    contour as well: a limb that has to slide along its own contour takes more steps.
    """

    ranking: ChamferSimilarity = ChamferSimilarity()
    """The distance, and which pairs agree in direction."""

    def distances(self, asked: Comparison, poses: Array) -> Array:
        """(B, V) px; see `tracker.evidence.similarity.Similarity.distances`."""
        return self.ranking.distances(asked, poses)

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """The pairs of all views in one linear system, robustly weighted as those of `chamfer`, scaled to px."""
        pairs = correspondences(asked, q, gate_px, self.ranking.direction_deg)
        residual, jacobian = incidence(pairs, asked, q)
        # an edge where the lens images nothing has no ray
        seen = np.isfinite(residual).all(axis=1)
        residual, jacobian = residual[seen], jacobian[seen]
        robust = (1 + (np.linalg.norm(residual, axis=1) / (0.5 * gate_px)) ** 2) ** -2
        weights = pairs.weights[seen] * robust
        found = Equations.of(residual.reshape(-1), jacobian.reshape(-1, asked.body.dof), weights.repeat(3))
        # of the three equations of a pair two are independent
        return replace(found, total=2 * float(weights.sum()))


def incidence(pairs: Correspondences, asked: Comparison, q: Array) -> tuple[Array, Array]:
    """Distances of model points from the rays of their edge points, linear in the pose.

    Args:
        pairs: N model points and edge points.
        asked: person and cameras.
        q: (dof,) the pose that the points were made at.

    Returns:
        ``X x n - m`` (N, 3), times focal length over distance so that it is in px, and its Jacobian (N, 3, dof).
    """
    directions, moments, px_per_m = _lines(pairs, asked.scene.rig)
    motion = asked.body.point_jacobian(q, pairs.points, pairs.parameters)
    residual = np.cross(pairs.points, directions) - moments
    jacobian = np.cross(motion, directions[:, None, :], axisa=1, axisb=2, axisc=1)
    return px_per_m[:, None] * residual, px_per_m[:, None, None] * jacobian


def _lines(pairs: Correspondences, rig: Rig) -> tuple[Array, Array, Array]:
    """Directions (N, 3) and moments (N, 3) of the edge points' rays; pixels (N,) per metre across them."""
    directions, moments = np.zeros_like(pairs.points), np.zeros_like(pairs.points)
    px_per_m = np.zeros(len(pairs.points))
    for v, camera in enumerate(rig.cameras):
        rows = np.flatnonzero(pairs.views == v)
        directions[rows] = camera.rays(pairs.pixels[rows])
        moments[rows] = np.cross(camera.centre, directions[rows])
        distances = np.linalg.norm(pairs.points[rows] - camera.centre, axis=1)
        px_per_m[rows] = np.sqrt(camera.matrix[0, 0] * camera.matrix[1, 1]) / distances
    return directions, moments, px_per_m
