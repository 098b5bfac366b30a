"""Smoothing: poses of a finished movement without jitter, short gaps filled, with velocities and accelerations."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
import pydantic
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array, Integers, Mask, frozen
from tracker.foundation.configuration.components import component


@dataclass(frozen=True)
class Stretch:
    """Poses of one person without a long gap; the first and the last one are known."""

    times_s: Array
    """(T,) seconds, rising."""

    poses: Array
    """(T, dof) rad and m; angles without jumps. Unknown poses are not to be used."""

    covariances: Array
    """(T, dof, dof) of the poses; NaN where the estimation gave none."""

    known: Mask
    """(T,) frames in which the person was found."""

    @property
    def sigmas(self) -> Array:
        """(T, dof) standard deviations; 1 where unknown, so that all have the same weight."""
        variances = np.diagonal(self.covariances, axis1=1, axis2=2)
        sigmas: Array = np.sqrt(np.where(np.isfinite(variances) & (variances > 0), variances, 1.0))
        return sigmas


@dataclass(frozen=True)
class Smoothed:
    """A stretch without jitter."""

    poses: Array
    """(T, dof) rad and m, unknown frames filled."""

    velocities: Array
    """(T, dof) rad/s and m/s."""

    accelerations: Array
    """(T, dof) rad/s2 and m/s2."""

    covariances: Array
    """(T, dof, dof) of the poses; NaN in filled frames where the method gives none."""


@runtime_checkable
class Smoothing(Protocol):
    """A component that smooths movements."""

    @property
    def max_gap_s(self) -> float:
        """Longest gap that is filled, seconds without a pose."""
        ...

    def check(self, interval_s: float) -> None:
        """Checks that the settings fit a recording, before it is tracked.

        Args:
            interval_s: usual time from one frame to the next.

        Raises:
            ConfigError: they do not.
        """
        ...

    def smooth(self, stretches: Sequence[Stretch]) -> list[Smoothed]:
        """Smooths the stretches of one person, all in the same way.

        Args:
            stretches: of `LEAST_FRAMES` known poses at least.
        """
        ...


LEAST_FRAMES = 8
"""A stretch with fewer known poses stays as it is: its jitter is unknown."""


def stretches_of(times_s: Array, known: Mask, interval_s: float, max_gap_s: float) -> list[slice]:
    """Stretches of a movement that are smoothed in one piece.

    Args:
        times_s: (T,) of the frames.
        known: (T,) frames in which the person was found.
        interval_s: usual time from one frame to the next.
        max_gap_s: longest time without a pose that is bridged.

    Returns:
        Ranges of frames that begin and end with a known one and hold `LEAST_FRAMES` of them at least.
    """
    found: Integers = np.flatnonzero(known)
    if not len(found):
        return []
    gaps = np.diff(times_s[found]) - interval_s
    pieces = np.split(found, np.flatnonzero(gaps > max_gap_s + 1e-3 * interval_s) + 1)
    return [slice(int(piece[0]), int(piece[-1]) + 1) for piece in pieces if len(piece) >= LEAST_FRAMES]


# Common parts of smoothings that treat every stretch separately.


@component
class Stretchwise:
    """Poses at all times of each stretch; without velocities of their own, those of a quintic spline."""

    max_gap_s: float = pydantic.Field(default=0.2, ge=0)
    """Longest gap that is filled, seconds without a pose; frames of longer ones stay lost."""

    def check(self, interval_s: float) -> None:
        """Any frame rate will do; see `tracker.results.smoothing.Smoothing.check`."""

    def smooth(self, stretches: Sequence[Stretch]) -> list[Smoothed]:
        """Smooths each; see `tracker.results.smoothing.Smoothing.smooth`."""
        return [self._with_derivatives(stretch) for stretch in stretches]

    @abstractmethod
    def _smoothed(self, stretch: Stretch) -> Array:
        """(T, dof) poses of a stretch, its unknown frames filled."""

    def _with_derivatives(self, stretch: Stretch) -> Smoothed:
        covariances = np.where(stretch.known[:, None, None], stretch.covariances, np.nan)
        return Smoothed(*self._courses(stretch), covariances)

    def _courses(self, stretch: Stretch) -> tuple[Array, Array, Array]:
        """(T, dof) each: smooth poses, their velocities and accelerations."""
        poses = self._smoothed(stretch)
        spline = make_interp_spline(stretch.times_s, poses, k=5)
        return poses, spline(stretch.times_s, nu=1), spline(stretch.times_s, nu=2)


def without_gaps(stretch: Stretch) -> Array:
    """(T, dof) poses, those of unknown frames interpolated in time."""
    times = stretch.times_s[stretch.known]
    columns = stretch.poses[stretch.known].T
    filled: Array = np.stack([np.interp(stretch.times_s, times, column) for column in columns], axis=1)
    return filled


# See docs/lab/rotations.md.
_FARTHEST = np.radians(150.0)
"""Rotation from the mean, and between known frames, from which on a joint keeps its angles: half a turn from the mean
vectors jump, and a person who turns on the spot has no mean."""

_LEAST_SIGMA = np.radians(0.05)
"""Least standard deviation of a rotation: angles do not show it about an axis that none turns about."""

_DAMPING = 1e-4
"""Damping of steps to the angles of a rotation, and of the way back of covariances, rad^2: in gimbal lock angles
stay."""

_STEPS = 50
"""Largest number of steps to the angles of a rotation; far from gimbal lock three to six are enough."""

_NEAR = 1e-9
"""Negligible rest of a rotation, rad."""


@dataclass(frozen=True)
class BallJoint:
    """Three angles of a pose that turn one joint."""

    columns: tuple[int, int, int]
    axes: Array
    """(3, 3) one a row, in the reference pose."""

    mean: Array
    """(3, 3) mean rotation of the movement."""

    def rotations(self, angles: Array) -> Rotation:
        """The T rotations of angles (T, 3), rad."""
        first, second, third = self._turns(angles)
        return first * second * third

    def _turns(self, angles: Array) -> list[Rotation]:
        return [Rotation.from_rotvec(angle[:, None] * axis) for angle, axis in zip(angles.T, self.axes, strict=True)]

    def velocities(self, angles: Array) -> Array:
        """(T, 3, 3) a column an angle: the axis it turns about, in what is turned."""
        _, second, third = self._turns(angles)
        first_axis, second_axis, third_axis = np.array(self.axes)
        within = (second * third).inv().apply(first_axis), third.inv().apply(second_axis)
        return np.stack([*within, np.broadcast_to(third_axis, within[0].shape)], axis=-1)

    def vectors(self, angles: Array) -> Array:
        """(T, 3) rotations from the mean along their axes, rad, of angles (T, 3)."""
        vectors: Array = (Rotation.from_matrix(np.array(self.mean)).inv() * self.rotations(angles)).as_rotvec()
        return vectors

    def slopes(self, angles: Array) -> Array:
        """(T, 3, 3) derivatives of `vectors` by the angles."""
        return _inverse_right(self.vectors(angles)) @ self.velocities(angles)

    def angles(self, vectors: Array, near: Array) -> Array:
        """Angles (T, 3) of rotations from the mean (T, 3), from those near by (T, 3) on; damped Gauss-Newton steps."""
        wanted, angles = Rotation.from_matrix(np.array(self.mean)) * Rotation.from_rotvec(vectors), near.copy()
        for _ in range(_STEPS):
            left = (self.rotations(angles).inv() * wanted).as_rotvec()
            if np.abs(left).max(initial=0.0) < _NEAR:
                break
            slopes = self.velocities(angles)
            across = slopes @ slopes.transpose(0, 2, 1) + _DAMPING * np.eye(3)
            step = slopes.transpose(0, 2, 1) @ np.linalg.solve(across, left[..., None])
            angles = angles + step[..., 0]
        return angles


def ball_joints(body: BodyModel, poses: Array) -> tuple[BallJoint, ...]:
    """The joints of a body that turn about three axes, and stay within reach of their mean in a movement.

    Args:
        body: the model.
        poses: (T, dof) of all the movement.
    """
    found = []
    for columns in _threes(body):
        joint = BallJoint(columns, frozen([body.parameters[k].axis for k in columns]), np.eye(3))
        angles = poses[:, np.array(columns)]
        joint = replace(joint, mean=frozen(joint.rotations(angles).mean().as_matrix()))
        vectors = joint.vectors(angles)
        farthest = np.linalg.norm(np.concatenate([vectors, np.diff(vectors, axis=0)]), axis=1).max()
        if farthest < _FARTHEST:
            found.append(joint)
    return tuple(found)


def _threes(body: BodyModel) -> list[tuple[int, int, int]]:
    """Angles that turn one joint, one after the other, if there are three."""
    joints: list[list[int]] = []
    for k, one in enumerate(body.parameters):
        before = body.parameters[one.parent] if one.parent >= 0 else None
        if one.rotates and before is not None and before.rotates and np.allclose(before.point, one.point):
            next(joint for joint in joints if one.parent in joint).append(k)
        elif one.rotates:
            joints.append([k])
    return [(joint[0], joint[1], joint[2]) for joint in joints if len(joint) == 3]


def with_vectors(stretch: Stretch, joints: Sequence[BallJoint]) -> Stretch:
    """A stretch with rotations from their mean in place of the angles of some joints, and with their covariances."""
    poses, slopes = stretch.poses.copy(), _identities(stretch.poses)
    least = np.zeros(poses.shape[1])
    for joint in joints:
        columns, known = np.array(joint.columns), np.flatnonzero(stretch.known)
        angles = stretch.poses[np.ix_(known, columns)]
        poses[np.ix_(known, columns)] = joint.vectors(angles)
        slopes[np.ix_(known, columns, columns)] = joint.slopes(angles)
        least[columns] = _LEAST_SIGMA**2
    covariances = slopes @ stretch.covariances @ slopes.transpose(0, 2, 1) + np.diag(least)
    return replace(stretch, poses=poses, covariances=covariances)


def with_angles(smooth: Smoothed, joints: Sequence[BallJoint], raw: Stretch) -> Smoothed:
    """A smooth movement with angles again; their derivatives are those of a quintic spline.

    In gimbal lock angles stay as the raw ones are, and as uncertain: the part of their covariances that smooth
    rotations lack is added.

    Args:
        smooth: a smoothed `with_vectors`.
        joints: the same.
        raw: with angles near the smooth ones.
    """
    poses, back, there = smooth.poses.copy(), _identities(smooth.poses), _identities(smooth.poses)
    velocities, accelerations = smooth.velocities.copy(), smooth.accelerations.copy()
    times = raw.times_s[raw.known]
    for joint in joints:
        columns = np.array(joint.columns)
        near = np.stack([np.interp(raw.times_s, times, raw.poses[raw.known, k]) for k in joint.columns], axis=1)
        angles = joint.angles(smooth.poses[:, columns], near)
        slopes = joint.slopes(angles)
        damped = slopes.transpose(0, 2, 1) @ slopes + _DAMPING * np.eye(3)
        block = np.ix_(np.arange(len(poses)), columns, columns)
        back[block], there[block] = np.linalg.solve(damped, slopes.transpose(0, 2, 1)), slopes
        spline = make_interp_spline(raw.times_s, angles, k=5)
        poses[:, columns] = angles
        velocities[:, columns], accelerations[:, columns] = spline(raw.times_s, nu=1), spline(raw.times_s, nu=2)
    stayed = _identities(smooth.poses) - back @ there
    covariances = back @ smooth.covariances @ back.transpose(0, 2, 1)
    covariances += stayed @ _raw_covariances(raw) @ stayed.transpose(0, 2, 1)
    return Smoothed(poses, velocities, accelerations, covariances)


def _raw_covariances(raw: Stretch) -> Array:
    """(T, dof, dof); frames without a pose have those of the next frame with one; missing ones have sigmas of 1."""
    known = np.flatnonzero(raw.known)
    nearest = known[np.searchsorted(known, np.arange(len(raw.known)))]  # the last frame of a stretch is known
    given = np.isfinite(raw.covariances).all(axis=(1, 2), keepdims=True)
    covariances: Array = np.where(given, raw.covariances, raw.sigmas[:, :, None] ** 2 * np.eye(raw.poses.shape[1]))
    return covariances[nearest]


def _identities(poses: Array) -> Array:
    """(T, dof, dof) for poses (T, dof)."""
    return np.broadcast_to(np.eye(poses.shape[1]), (*poses.shape, poses.shape[1])).copy()


def _inverse_right(vectors: Array) -> Array:
    """(T, 3, 3) derivatives of rotation vectors (T, 3) by a small rotation of the turned frame.

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
