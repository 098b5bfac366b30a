"""Joints that turn about three axes, one after the other, as rotations.

Where the first and the last of three axes nearly coincide (gimbal lock), angles about them change quickly and against
each other while the limb hardly moves: an arm that is raised sidewards, or strikes forwards. What is smoothed or
carried on there is another movement. Rotations from one near by, as vectors along their axes, have no such place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tracker.arrays import Array, Integers, Mask, frozen
from tracker.kernels.body.ball_joints import angles_near, turned, vectors_from
from tracker.segments import Parameter


@dataclass(frozen=True)
class BallJoints:
    """J joints that three angles of a pose turn each."""

    columns: Integers
    """(J, 3) of a pose."""

    axes: Array
    """(J, 3, 3) unit vectors in the reference pose, one a row."""

    @staticmethod
    def of(parameters: Sequence[Parameter]) -> BallJoints:
        """Those of a body's parameters, its root too; none of fewer angles, or of more."""
        joints: list[list[int]] = []
        for k, one in enumerate(parameters):
            before = parameters[one.parent] if one.parent >= 0 else None
            if one.rotates and before is not None and before.rotates and np.allclose(before.point, one.point):
                next(joint for joint in joints if one.parent in joint).append(k)
            elif one.rotates:
                joints.append([k])
        columns = [joint for joint in joints if len(joint) == 3]
        axes = [[parameters[k].axis for k in joint] for joint in columns]
        return BallJoints(frozen(columns, np.int64).reshape(-1, 3), frozen(axes).reshape(-1, 3, 3))

    def __len__(self) -> int:
        return len(self.columns)

    def chosen(self, joints: Mask) -> BallJoints:
        """Some of them, a mask (J,)."""
        return replace(self, columns=frozen(self.columns[joints], np.int64), axes=frozen(self.axes[joints]))

    def rotations(self, pose: Array) -> Array:
        """(J, 3, 3) at a pose (dof,)."""
        rotations = np.empty((len(self), 3, 3))
        turned(np.ascontiguousarray(pose, dtype=np.float64), self.columns, self.axes, rotations)
        return rotations

    def vectors(self, poses: Array, means: Array) -> Array:
        """(T, J, 3) rotations at poses (T, dof) from others (J, 3, 3), rad; right for less than half a turn."""
        vectors = np.empty((len(poses), len(self), 3))
        vectors_from(np.ascontiguousarray(poses, dtype=np.float64), self.columns, self.axes, means, vectors)
        return vectors

    def with_angles(self, vectors: Array, means: Array, near: Array) -> Array:
        """Poses (T, dof) like those near by (T, dof), the joints rotated from the means by vectors (T, J, 3)."""
        poses = np.array(near, dtype=np.float64)
        angles_near(np.ascontiguousarray(vectors), self.columns, self.axes, means, poses)
        return poses
