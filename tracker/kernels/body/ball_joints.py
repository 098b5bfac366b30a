"""Joints that three angles turn, one after the other: their rotations, as vectors too, and the angles of these."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Integers
from tracker.kernels.compilation import compiled

_STEPS = 50
"""Towards the angles of a rotation at most; far from gimbal lock three to six do."""

_NEAR = 1e-10
"""Rotation left over that is none, rad."""

_DAMPING = 1e-4
"""Of steps to the angles of a rotation, rad^2: where two of the axes are one they stay as they are."""


@compiled
def turned(pose: Array, columns: Integers, axes: Array, rotations: Array) -> None:
    """Rotations of joints at a pose.

    Args:
        pose: (dof,) rad and m.
        columns: (J, 3) the angles of each joint.
        axes: (J, 3, 3) unit axes, one a row.
        rotations: (J, 3, 3) out.
    """
    for j in range(len(columns)):
        angles = np.array([pose[columns[j, 0]], pose[columns[j, 1]], pose[columns[j, 2]]])
        rotations[j] = _rotation(angles, axes[j])[0]


@compiled
def vectors_from(poses: Array, columns: Integers, axes: Array, means: Array, vectors: Array) -> None:
    """Rotations of joints at many poses, from others, as vectors along their axes.

    Args:
        poses: (T, dof).
        columns, axes: as of `turned`.
        means: (J, 3, 3) what rotations are told from.
        vectors: (T, J, 3) out, rad.
    """
    for t in range(len(poses)):
        for j in range(len(columns)):
            angles = np.array([poses[t, columns[j, 0]], poses[t, columns[j, 1]], poses[t, columns[j, 2]]])
            vectors[t, j] = _logarithm(means[j].T.copy() @ _rotation(angles, axes[j])[0])


@compiled
def angles_near(vectors: Array, columns: Integers, axes: Array, means: Array, poses: Array) -> None:
    """Angles of rotations by damped Gauss-Newton steps.

    Args:
        vectors: (T, J, 3) rotations from the means.
        columns, axes, means: as of `vectors_from`.
        poses: (T, dof) angles near by in, those of the rotations out.
    """
    for t in range(len(vectors)):
        for j in range(len(columns)):
            wanted = means[j].copy() @ _exponential(vectors[t, j])
            angles = np.array([poses[t, columns[j, 0]], poses[t, columns[j, 1]], poses[t, columns[j, 2]]])
            for _ in range(_STEPS):
                rotation, slopes = _rotation(angles, axes[j])
                left = _logarithm(rotation.T.copy() @ wanted)
                if np.abs(left).max() < _NEAR:
                    break
                angles = angles + slopes.T.copy() @ _solved(slopes @ slopes.T.copy(), left)
            for k in range(3):
                poses[t, columns[j, k]] = angles[k]


@compiled
def _rotation(angles: Array, axes: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) of three angles; (3, 3) a column an angle: the axis that it turns about, in what is turned."""
    second, third = _about(axes[1], angles[1]), _about(axes[2], angles[2])
    behind = second @ third
    slopes = np.empty((3, 3))
    slopes[:, 0] = behind.T.copy() @ axes[0].copy()
    slopes[:, 1] = third.T.copy() @ axes[1].copy()
    slopes[:, 2] = axes[2]
    return _about(axes[0], angles[0]) @ behind, slopes


@compiled
def _about(axis: Array, angle: float) -> Array:
    return _exponential(axis * angle)


@compiled
def _exponential(vector: Array) -> Array:
    """(3, 3) rotation of a vector (3,): Rodrigues."""
    angle = np.sqrt((vector**2).sum())
    x, y, z = vector
    crossed = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-4:
        first, second = 1 - angle**2 / 6, 0.5 - angle**2 / 24
    else:
        first, second = np.sin(angle) / angle, (1 - np.cos(angle)) / angle**2
    return np.eye(3) + first * crossed + second * (crossed @ crossed)


@compiled
def _logarithm(rotation: Array) -> Array:
    """(3,) vector of a rotation (3, 3) of less than half a turn."""
    across = np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine = np.sqrt((across**2).sum()) / 2
    angle = np.arctan2(sine, (rotation[0, 0] + rotation[1, 1] + rotation[2, 2] - 1) / 2)
    return across * (0.5 if sine < 1e-9 else angle / (2 * sine))


@compiled
def _solved(matrix: Array, right: Array) -> Array:
    """(3,) solution of a symmetric matrix (3, 3), damped; by its adjoint."""
    a, b, c = matrix[0, 0] + _DAMPING, matrix[0, 1], matrix[0, 2]
    d, e, f = matrix[1, 1] + _DAMPING, matrix[1, 2], matrix[2, 2] + _DAMPING
    aa, bb, cc = d * f - e * e, c * e - b * f, b * e - c * d
    adjoint = np.array([[aa, bb, cc], [bb, a * f - c * c, b * c - a * e], [cc, b * c - a * e, a * d - b * b]])
    return adjoint @ right / (a * aa + b * bb + c * cc)
