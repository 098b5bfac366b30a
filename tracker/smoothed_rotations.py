"""Movements in coordinates that can be smoothed: rotations of ball joints from their mean, in place of three angles.

Of V-Dance, whose arms are raised sidewards, the wrists were 15 and 22 mm off (offsets removed), 28 and 29 after
smoothing angles, 19 and 24 so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from tracker.arrays import Array, frozen
from tracker.ball_joints import BallJoints
from tracker.body import BodyModel
from tracker.smoothing import Smoothed, Stretch

_FARTHEST = np.radians(150.0)
"""Rotation from the mean, and from one known frame to the next, from which on a joint keeps its angles: half a turn
from the mean vectors jump, and whoever turns on the spot has none."""

_LEAST_SIGMA = np.radians(0.05)
"""Standard deviation of a rotation at the least: of an axis that no angle turns about, they tell nothing."""

_DAMPING = 1e-4
"""Of the way back of covariances, rad^2: in gimbal lock angles are hardly known."""


@dataclass(frozen=True)
class Turning:
    """The ball joints of a movement that stay within reach of their means, and these."""

    joints: BallJoints
    means: Array
    """(J, 3, 3)"""

    @staticmethod
    def of(body: BodyModel, poses: Array) -> Turning:
        """Those of a body in a movement, poses (T, dof) in which it is known."""
        joints = body.ball_joints
        means = np.empty((len(joints), 3, 3))
        for j, (columns, axes) in enumerate(zip(joints.columns, joints.axes, strict=True)):
            first, second, third = _turns(axes, poses[:, columns])
            means[j] = (first * second * third).mean().as_matrix() if len(poses) else np.eye(3)
        vectors = joints.vectors(poses, means)
        farthest = np.linalg.norm(np.concatenate([vectors, np.diff(vectors, axis=0)]), axis=2).max(axis=0, initial=0.0)
        near = farthest < _FARTHEST
        return Turning(joints.chosen(near), frozen(means[near]))

    def vectors_of(self, stretch: Stretch) -> Stretch:
        """A stretch with rotations from their means in place of the angles, in its covariances, too."""
        known, columns = np.flatnonzero(stretch.known), self.joints.columns
        poses, slopes = stretch.poses.copy(), _identities(stretch.poses)
        vectors = self.joints.vectors(stretch.poses[known], self.means)
        slopes_known = self._slopes(stretch.poses[known], vectors)
        least = np.zeros(poses.shape[1])
        for j, own in enumerate(columns):
            poses[np.ix_(known, own)] = vectors[:, j]
            slopes[np.ix_(known, own, own)] = slopes_known[:, j]
            least[own] = _LEAST_SIGMA**2
        covariances = slopes @ stretch.covariances @ slopes.transpose(0, 2, 1) + np.diag(least)
        return replace(stretch, poses=poses, covariances=covariances)

    def angles_of(self, smooth: Smoothed, raw: Stretch) -> Smoothed:
        """A smooth movement with angles again; their derivatives are those of a quintic spline.

        Args:
            smooth: of `vectors_of` a stretch.
            raw: the stretch, whose angles the smooth ones are near to.
        """
        columns, times = self.joints.columns, raw.times_s[raw.known]
        vectors = smooth.poses[:, columns]
        near = smooth.poses.copy()
        for k in columns.ravel():
            near[:, k] = np.interp(raw.times_s, times, raw.poses[raw.known, k])
        poses = self.joints.with_angles(vectors, self.means, near)
        velocities, accelerations, back = smooth.velocities.copy(), smooth.accelerations.copy(), _identities(poses)
        slopes = self._slopes(poses, vectors)
        damped = slopes.transpose(0, 1, 3, 2) @ slopes + _DAMPING * np.eye(3)
        inverse = np.linalg.solve(damped, slopes.transpose(0, 1, 3, 2))
        for j, own in enumerate(columns):
            back[np.ix_(np.arange(len(poses)), own, own)] = inverse[:, j]
            spline = make_interp_spline(raw.times_s, poses[:, own], k=5)
            velocities[:, own], accelerations[:, own] = spline(raw.times_s, nu=1), spline(raw.times_s, nu=2)
        covariances = back @ smooth.covariances @ back.transpose(0, 2, 1)
        return Smoothed(poses, velocities, accelerations, covariances)

    def _slopes(self, poses: Array, vectors: Array) -> Array:
        """(T, J, 3, 3) derivatives of the vectors (T, J, 3) by the angles of poses (T, dof)."""
        slopes = np.empty((len(poses), len(self.joints), 3, 3))
        for j, (columns, axes) in enumerate(zip(self.joints.columns, self.joints.axes, strict=True)):
            _, second, third = _turns(axes, poses[:, columns])
            slopes[:, j, :, 0] = (second * third).inv().apply(np.array(axes[0]))
            slopes[:, j, :, 1] = third.inv().apply(np.array(axes[1]))
            slopes[:, j, :, 2] = axes[2]
            slopes[:, j] = _inverse_right(vectors[:, j]) @ slopes[:, j]
        return slopes


def _turns(axes: Array, angles: Array) -> list[Rotation]:
    """Rotations by angles (T, 3) about axes (3, 3)."""
    return [Rotation.from_rotvec(angle[:, None] * axis) for angle, axis in zip(angles.T, axes, strict=True)]


def _identities(poses: Array) -> Array:
    """(T, dof, dof) for poses (T, dof)."""
    return np.broadcast_to(np.eye(poses.shape[1]), (*poses.shape, poses.shape[1])).copy()


def _inverse_right(vectors: Array) -> Array:
    """(T, 3, 3) how rotation vectors (T, 3) change with a small rotation of what is turned.

    The inverse of the right Jacobian of SO(3) (Chirikjian, Stochastic Models, Information Theory, and Lie Groups,
    vol. 2, 2012, section 10.6).
    """
    angle = np.linalg.norm(vectors, axis=1)
    small = angle < 1e-3
    safe = np.where(small, 1.0, angle)
    curved = np.where(small, 1 / 12 + angle**2 / 720, 1 / safe**2 - (1 + np.cos(safe)) / (2 * safe * np.sin(safe)))
    crossed = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    crossed[:, 0, 1], crossed[:, 0, 2], crossed[:, 1, 2] = -z, y, -x
    crossed -= crossed.transpose(0, 2, 1)
    matrices: Array = np.eye(3) + crossed / 2 + curved[:, None, None] * crossed @ crossed
    return matrices
