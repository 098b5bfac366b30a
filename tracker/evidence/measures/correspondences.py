"""Oriented correspondences between model contours and scene edges, and their residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.contours import PX_PER_OBSERVATION, Contours
from tracker.bodies.scene import Scene
from tracker.cameras.rig import Rig
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.arrays import Array, Integers, Mask, frozen
from tracker.images.sight import PackedEdges
from tracker.kernels.contours import match_oriented
from tracker.kernels.rows import SampleRow, ScenePointRow


@dataclass(frozen=True)
class Correspondences:
    """N pairs of a model contour point and its scene edge point."""

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
    """(N,) weight of the squared residual: the pair's number of independent observations."""

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


def oriented_pairs(contours: Contours, edges: PackedEdges, gate_px: float, direction_deg: float) -> Integers:
    """(N, 4) oriented nearest neighbours both ways between the first pose's contours and edges; see `match_oriented`.

    Args:
        contours: of the model.
        edges: of the images.
        gate_px: largest distance of a pair, px.
        direction_deg: largest angle between model normal and scene gradient, modulo sign, degrees.
    """
    pairs = np.empty((int(contours.counts[0].sum()) + len(edges.points), 4), dtype=np.int64)
    gate = gate_px, float(np.cos(np.radians(direction_deg)))
    return pairs[: match_oriented(contours.positions[0], contours.counts[0], edges.points, edges.first, gate, pairs)]


def voted_pairs(
    asked: Comparison, contours: Contours, gate_px: float, direction_deg: float, limbs: Integers
) -> Integers:
    """Pairs (N, 4) as `oriented_pairs` has them, except that a segment of edges pairs with only one limb.

    The points of a segment vote for the limb with the nearest contour, each by its length, and the segment is paired
    with the limb that gets most votes (Rosenhahn et al. 2006, section 2.2): where an arm passes the trunk, an edge does
    not pull at both.

    Args:
        asked: its observation is an `Observation`.
        contours: of the model.
        gate_px, direction_deg: as of `oriented_pairs`.
        limbs: (P,) limb of each part of the scene.
    """
    edges, segments = asked.observed.packed, asked.observed.packed_segments
    pairs = oriented_pairs(contours, edges, gate_px, direction_deg)
    voting = pairs[pairs[:, 3] == 1]
    if not len(voting):
        return pairs
    votes = np.zeros((int(segments.max()) + 1, int(limbs.max()) + 1))
    voted = limbs[contours.parts[0][voting[:, 0], voting[:, 1]]]
    np.add.at(votes, (segments[voting[:, 2]], voted), edges.points[voting[:, 2], ScenePointRow.WEIGHT])
    winners = np.where(votes.any(axis=1), votes.argmax(axis=1), -1)[segments]
    of_samples = limbs[np.where(contours.valid[0], contours.parts[0], 0)]
    found = []
    for limb in np.unique(voted):
        rows, positions = np.flatnonzero(winners == limb), contours.positions.copy()
        positions[0, of_samples != limb, SampleRow.LENGTH] = 0
        first = np.searchsorted(rows, edges.first)
        theirs = edges._replace(points=frozen(edges.points[rows], np.float32), first=frozen(first, np.int64))
        own = oriented_pairs(replace(contours, positions=positions), theirs, gate_px, direction_deg)
        own[:, 2] = rows[own[:, 2]]
        found.append(own)
    return np.concatenate(found)


def limbs_of(scene: Scene) -> Integers:
    """(P,) limb of each part of a scene: arms, legs and trunk of every person, numbered from 0."""
    numbers, start = [], 0
    for person in scene.persons:
        body, own = person.body, np.zeros(len(person.body.parts), dtype=np.int64)
        for k, group in enumerate(body.fine_groups, start=1):
            own[body.parts_of(group)] = k
        numbers.append(own + start)
        start += len(body.fine_groups) + 1
    found: Integers = frozen(np.concatenate(numbers), np.int64)
    return found


def correspondences(asked: Comparison, q: Array, gate_px: float, direction_deg: float) -> Correspondences:
    """Oriented nearest neighbours between a person's contours and the edges observed, both ways, one by one.

    Args:
        asked: scene and person; its observation is an `Observation`.
        q: (dof,) rad and m.
        gate_px: largest distance of a pair, px.
        direction_deg: largest angle between model normal and scene gradient, modulo sign, degrees.

    Returns:
        Pairs of the person's own parts, weighted in observations of 8 px of contour.
    """
    contours, edges = asked.fine(q), asked.observed.packed
    pairs = oriented_pairs(contours, edges, gate_px, direction_deg)
    parts = contours.parts[0][pairs[:, 0], pairs[:, 1]]
    own: Mask = (parts >= asked.own.start) & (parts < asked.own.stop)
    pairs, parts = pairs[own], parts[own] - asked.own.start
    views, samples, found = pairs[:, 0], pairs[:, 1], pairs[:, 2]
    rows = contours.positions[0][views, samples].astype(np.float64)
    length = np.where(pairs[:, 3] == 0, rows[:, 4], edges.points[found, 4])
    return Correspondences(
        points=contours.points[0][views, samples].astype(np.float64),
        parameters=asked.body.part_parameters[parts],
        views=np.ascontiguousarray(views),
        normals=np.ascontiguousarray(rows[:, 2:4]),
        pixels=edges.points[found, :2].astype(np.float64),
        weights=length / PX_PER_OBSERVATION,
    )


# Normal equations of a linearized least squares problem in a pose.


@dataclass(frozen=True)
class Equations:
    """J^T W J dq = -J^T W r, with the sums for the variance; several kinds of evidence add up."""

    matrix: Array
    """(dof, dof) J^T W J."""

    vector: Array
    """(dof,) J^T W r."""

    squares: float
    """Sum of w r^2, px^2."""

    total: float
    """Sum of w: the number of independent observations."""

    @staticmethod
    def of(residual: Array, jacobian: Array, weights: Array) -> Equations:
        """The equations of residuals (N,) px with Jacobian (N, dof) and weights (N,)."""
        weighted = weights[:, None] * jacobian
        squares = float((weights * residual**2).sum())
        return Equations(jacobian.T @ weighted, weighted.T @ residual, squares, float(weights.sum()))

    def pulled(self, weights: Array, offsets: Array) -> Equations:
        """The equations with a pull on each parameter (dof,), by its offset (dof,) from its target.

        The variance of a residual stays: a pull is not an observation.
        """
        matrix = self.matrix.copy()
        matrix[np.diag_indices(len(weights))] += weights
        return replace(self, matrix=matrix, vector=self.vector + weights * offsets)

    @staticmethod
    def nothing(dof: int) -> Equations:
        """Equations without content."""
        return Equations(np.zeros((dof, dof)), np.zeros(dof), 0.0, 0.0)


def combined(equations: Sequence[Equations], weights: Sequence[float]) -> Equations:
    """The sum of equations of the same pose, each times its weight; at least one."""
    weight, first = weights[0], equations[0]
    matrix, vector = weight * first.matrix, weight * first.vector
    squares, total = weight * first.squares, weight * first.total
    for weight, one in zip(weights[1:], equations[1:], strict=True):
        matrix += weight * one.matrix
        vector += weight * one.vector
        squares += weight * one.squares
        total += weight * one.total
    return Equations(matrix, vector, squares, total)
