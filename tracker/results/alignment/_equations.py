"""Normal equations of delays and turns, moment by moment, whose poses are eliminated (Schur complement)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tracker.bodies.scene import Scene
from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.measures.correspondences import correspondences
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.arrays import Array, Integers
from tracker.images.sight import Observation, Sight
from tracker.results.alignment.moments import Moment
from tracker.synthesis.cpu import CpuSynthesis


def without_common_motion(rig: Rig, turns: Array, middle: Array) -> Array:
    """Turns less those that moving the world would explain: only the rest contradicts the calibration.

    Args:
        rig: V cameras.
        turns: (V, 3) rotation vectors in camera coordinates, rad.
        middle: (3,) of what is seen, metres.

    Returns:
        (V, 3) rad.
    """
    columns = np.concatenate([_as_turns(camera.camera_from_world, middle) for camera in rig.cameras])
    moved, *_ = np.linalg.lstsq(columns, turns.ravel(), rcond=None)
    left: Array = (turns.ravel() - columns @ moved).reshape(turns.shape)
    return left


def _as_turns(camera_from_world: Array, middle: Array) -> Array:
    """(3, 6) turns of a camera that show what a small translation (m) and rotation (rad) about the middle would."""
    rotation = camera_from_world[:3, :3]
    distance = float(rotation[2] @ middle + camera_from_world[2, 3])
    # a point moved by (dx, dy) at its distance is seen as by a camera turned by (-dy, dx) / distance
    across = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]) / max(distance, 1e-6)
    about = np.zeros((3, 3))
    about[2, 2] = 1.0
    return np.hstack([across @ rotation, about @ rotation])


# One person in one view: edges seen, and the equations that draw the contours to them.

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


_TURN_SPREAD_PX = 0.5
"""Standard deviation of turns, px at the middle of an image, so that what moving the world would explain is not
ascribed to the cameras; far more pairs speak for a turn that is one."""

_DELAY_SPREAD_FRAMES = 2.0
"""Standard deviation of delays: holds that of a view that shows nothing."""


@dataclass(frozen=True)
class Unknowns:
    """Delays of all views but the first, in frames, once for each part of a recording, and turns of all views."""

    delays: Array
    """(K, V - 1) frames"""

    turns: Array
    """(V, 3) rad"""

    @staticmethod
    def nothing(n_parts: int, n_views: int) -> Unknowns:
        """No view is late, none turned."""
        return Unknowns(np.zeros((n_parts, n_views - 1)), np.zeros((n_views, 3)))

    @property
    def values(self) -> Array:
        """(G,) all in one."""
        every: Array = np.r_[self.delays.ravel(), self.turns.ravel()]
        return every

    def moved(self, step: Array) -> Unknowns:
        """The unknowns a step (G,) further."""
        n = self.delays.size
        return Unknowns(self.delays + step[:n].reshape(self.delays.shape), self.turns + step[n:].reshape(-1, 3))

    def late_frames(self, part: int) -> Array:
        """(V,) delays of all views in a part, frames."""
        late: Array = np.r_[0.0, self.delays[part]]
        return late

    def columns(self, part: int) -> Integers:
        """(4V - 1,) places of what a moment of a part tells of, in `values`."""
        n_delays = self.delays.shape[1]
        own: Integers = part * n_delays + np.arange(n_delays)
        return np.concatenate([own, self.delays.size + np.arange(self.turns.size)])

    def prior(self, focal_px: Array) -> Array:
        """(G, G) how firmly delays and turns are held at nothing, by cameras of such focal lengths (V,), px."""
        firm = [np.full(self.delays.size, 1 / _DELAY_SPREAD_FRAMES), np.repeat(focal_px / _TURN_SPREAD_PX, 3)]
        return np.diag(np.concatenate(firm) ** 2)


@dataclass(frozen=True)
class Eliminated:
    """What a moment says of delays and turns, whatever its pose."""

    matrix: Array
    """(4V - 1, 4V - 1)"""

    vector: Array
    """(4V - 1,)"""

    still: Array
    """(dof,) step of the pose if delays and turns stay."""

    per_unknown: Array
    """(dof, 4V - 1) its change with these."""

    def moved(self, q: Array, step: Array) -> Array:
        """The pose (dof,) that goes with a step of the unknowns (4V - 1,)."""
        pose: Array = q + self.still + self.per_unknown @ step
        return pose


def eliminated(
    moment: Moment, looks: Sequence[Look], q: Array, late_frames: Array, interval_s: float, gate_px: float
) -> Eliminated:
    """The equations of a moment at a pose (dof,) and delays (V,) of the views."""
    person, n_views = moment.scene.persons[moment.person], len(late_frames)
    spread = np.where(person.body.rotates, *POSE_SPREAD)
    matrix, vector = np.diag(spread**-2), (q - person.q) / spread**2
    n_unknowns = 4 * n_views - 1
    crossed, own, right = np.zeros((n_unknowns, len(q))), np.zeros((n_unknowns, n_unknowns)), np.zeros(n_unknowns)
    for look in looks:
        seen = moment.later(q, interval_s * late_frames[look.view])
        residuals, jacobian, by_turn, weights = look.rows(seen, gate_px)
        columns = np.zeros((len(residuals), n_unknowns))
        if look.view:
            columns[:, look.view - 1] = jacobian @ (interval_s * moment.rates[0])
        first = n_views - 1 + 3 * look.view
        columns[:, first : first + 3] = by_turn
        weighted, weighted_columns = weights[:, None] * jacobian, weights[:, None] * columns
        matrix = matrix + jacobian.T @ weighted
        vector = vector + weighted.T @ residuals
        crossed += columns.T @ weighted
        own += columns.T @ weighted_columns
        right += weighted_columns.T @ residuals
    solved = np.linalg.solve(matrix, np.column_stack([vector, crossed.T]))
    return Eliminated(own - crossed @ solved[:, 1:], right - crossed @ solved[:, 0], -solved[:, 0], -solved[:, 1:])


@dataclass(frozen=True)
class Sums:
    """The equations of all moments in the unknowns of the whole recording."""

    matrices: Array
    """(M, G, G)"""

    vectors: Array
    """(M, G)"""

    prior: Array
    """(G, G)"""

    at: Unknowns

    @staticmethod
    def of(told: Sequence[Eliminated], parts: Integers, at: Unknowns, focal_px: Array) -> Sums:
        """Of moments, each in a part (M,) of the recording, at unknowns with as many parts."""
        n = at.values.size
        matrices, vectors = np.zeros((len(told), n, n)), np.zeros((len(told), n))
        for k, (one, part) in enumerate(zip(told, parts, strict=True)):
            columns = at.columns(part)
            matrices[k][np.ix_(columns, columns)] = one.matrix
            vectors[k, columns] = one.vector
        return Sums(matrices, vectors, at.prior(focal_px), at)

    def step(self) -> Array:
        """(G,) from the unknowns to better ones."""
        step: Array = -np.linalg.solve(self.matrices.sum(axis=0) + self.prior, self._slope)
        return step

    @property
    def gain(self) -> float:
        """By how much the step betters the cost, half the sum of weighted squares."""
        return float(-0.5 * self._slope @ self.step())

    def without_each(self) -> Array:
        """(M, G) steps with each moment left out in turn."""
        every = np.arange(len(self.vectors))
        left = [replace(self, matrices=self.matrices[every != k], vectors=self.vectors[every != k]) for k in every]
        return np.array([sums.step() for sums in left])

    @property
    def _slope(self) -> Array:
        slope: Array = self.vectors.sum(axis=0) + self.prior @ self.at.values
        return slope


def jackknife(estimates: Array) -> Array:
    """(...,) standard deviations of what estimates (M, ...) without each of M observations in turn tell."""
    n = len(estimates)
    sigmas: Array = np.sqrt((n - 1) / n * ((estimates - estimates.mean(axis=0)) ** 2).sum(axis=0))
    return sigmas
