"""Joints that turn about three axes: the same rotations as vectors and as angles, and smooth in gimbal lock."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tracker.arrays import Array
from tracker.ball_joints import BallJoints
from tracker.body import BodyModel
from tracker.body_files import load_body
from tracker.prediction.polynomial import PolynomialPrediction
from tracker.resources import model_path
from tracker.smoothed_rotations import Turning
from tracker.smoothing import Smoothed, Stretch
from tracker.smoothing.rts import RauchTungStriebel
from tracker.trajectory import History

FPS = 50.0
SIGMA = np.radians(1.0)
BALLS = "torso", "spine", "neck", "left_arm", "right_arm", "left_leg", "right_leg"


@pytest.fixture(scope="module")
def body() -> BodyModel:
    return load_body(model_path("human"))


@pytest.fixture(scope="module")
def joint() -> BallJoints:
    """One with the axes of the world."""
    return BallJoints(np.array([[0, 1, 2]]), np.eye(3)[None])


def moved(body: BodyModel, n: int = 40, size: float = 0.4, seed: int = 0) -> Array:
    """All joints swing about the rest pose, whatever their limits."""
    phases = np.random.default_rng(seed).uniform(0, 6, body.dof)
    return np.asarray(body.rest() + size * np.sin(np.arange(n)[:, None] / 6 + phases) * body.rotates)


def stretch_of(poses: Array, known: np.ndarray | None = None) -> Stretch:
    n, dof = poses.shape
    known = np.ones(n, dtype=bool) if known is None else known
    mixing = np.random.default_rng(1).normal(size=(dof, dof)) / np.sqrt(dof)
    covariance = SIGMA**2 * (mixing @ mixing.T + np.eye(dof))
    return Stretch(np.arange(n) / FPS, np.where(known[:, None], poses, np.nan), np.tile(covariance, (n, 1, 1)), known)


def through_the_lock(joint: BallJoints, true: Rotation) -> Array:
    """Angles of rotations one after the other."""
    angles, near = np.zeros((len(true), 3)), np.array([[0.0, 1.4, 0.0]])
    for t, vector in enumerate(true.as_rotvec()):
        angles[t] = near = joint.with_angles(vector[None, None], np.eye(3)[None], near)
    return angles


def swung(n: int = 80) -> Rotation:
    """An arm that goes by the direction in which its first and its last axis are one."""
    swing = np.linspace(-1, 1, n)
    return Rotation.from_rotvec(np.stack([0.15 * swing, np.full(n, np.pi / 2 - 0.02), 0.9 * swing], axis=1))


def rotation_of(joint: BallJoints, angles: Array) -> Rotation:
    return Rotation.from_matrix(np.concatenate([joint.rotations(one) for one in angles]))


def test_joints_are_those_with_three_angles(body: BodyModel) -> None:
    found = [{body.names[k].rpartition("_")[0] for k in columns} for columns in body.ball_joints.columns]
    assert [names for (names,) in found] == list(BALLS)
    np.testing.assert_allclose(np.linalg.norm(body.ball_joints.axes, axis=2), 1.0)


def test_rotations_are_those_of_the_body(body: BodyModel) -> None:
    poses = moved(body)
    pelvis = [part.name for part in body.parts].index("pelvis")
    placed = body.world_from_part(poses)[:, pelvis, :3, :3] @ body.model_from_parts[pelvis, :3, :3].T
    np.testing.assert_allclose([body.ball_joints.rotations(q)[0] for q in poses], placed, atol=1e-12)


def test_vectors_are_those_of_scipy_and_lead_back(body: BodyModel) -> None:
    poses, joints = moved(body, size=0.8), body.ball_joints
    means = np.array(joints.rotations(poses[7]))
    vectors = joints.vectors(poses, means)
    for j in range(len(joints)):
        rotations = Rotation.from_matrix([joints.rotations(q)[j] for q in poses])
        expected = (Rotation.from_matrix(means[j]).inv() * rotations).as_rotvec()
        np.testing.assert_allclose(vectors[:, j], expected, atol=1e-9)
    near = poses + 0.2 * np.random.default_rng(3).normal(size=poses.shape) * body.rotates
    back = joints.with_angles(vectors, means, near)
    own = joints.columns.ravel()
    np.testing.assert_allclose(back[:, own], poses[:, own], atol=1e-7)
    others = np.setdiff1d(np.arange(body.dof), own)
    np.testing.assert_array_equal(back[:, others], near[:, others])


def test_slopes_are_finite_differences(body: BodyModel) -> None:
    poses, h = moved(body, size=0.6), 1e-6
    turning = Turning.of(body, poses)
    joints, means = turning.joints, turning.means
    slopes = turning._slopes(poses, joints.vectors(poses, means))
    for j, columns in enumerate(joints.columns):
        for n, k in enumerate(columns):
            step = h * np.eye(body.dof)[k]
            ends = [joints.vectors(poses + sign * step, means)[:, j] for sign in (1, -1)]
            np.testing.assert_allclose(slopes[:, j, :, n], (ends[0] - ends[1]) / (2 * h), atol=1e-6)


def test_what_is_not_smoothed_is_the_same_movement(body: BodyModel) -> None:
    poses = moved(body, size=0.6)
    known = np.ones(len(poses), dtype=bool)
    known[10:13] = False
    stretch, turning = stretch_of(poses, known), Turning.of(body, poses[known])
    assert len(turning.joints) == len(BALLS)
    there = turning.vectors_of(stretch)
    assert np.isnan(there.poses[~known]).all()
    filled = turning.vectors_of(stretch_of(poses)).poses
    zeros = np.zeros_like(poses)
    back = turning.angles_of(Smoothed(filled, zeros, zeros, there.covariances), stretch)
    np.testing.assert_allclose(back.poses, poses, atol=1e-6)
    columns = turning.joints.columns.ravel()
    rates = np.gradient(poses, 1 / FPS, axis=0)
    np.testing.assert_allclose(back.velocities[5:-5, columns], rates[5:-5, columns], atol=0.1)
    sigmas = np.sqrt(np.diagonal(back.covariances, axis1=1, axis2=2))[known]
    others = np.setdiff1d(np.arange(body.dof), columns)
    np.testing.assert_allclose(sigmas[:, others], stretch.sigmas[known][:, others])
    np.testing.assert_allclose(sigmas[:, columns], stretch.sigmas[known][:, columns], rtol=0.05)


@pytest.mark.parametrize("turns", [0.9, 1.5, -2.0])
def test_whoever_turns_on_the_spot_keeps_the_angles(body: BodyModel, turns: float) -> None:
    poses = moved(body)
    poses[:, body.root.turn] = np.linspace(0, 2 * np.pi * turns, len(poses))
    np.testing.assert_array_equal(Turning.of(body, poses).joints.columns, body.ball_joints.columns[1:])


def test_a_joint_is_smooth_in_gimbal_lock(joint: BallJoints) -> None:
    """The noise is that of its rotations."""
    true, rng = swung(), np.random.default_rng(2)
    angles = through_the_lock(joint, true * Rotation.from_rotvec(SIGMA * rng.normal(size=(len(true), 3))))
    assert np.abs(np.diff(angles, axis=0)).max() > 0.2
    turning = Turning(joint, np.array([true.mean().as_matrix()]))
    slopes = turning._slopes(angles, joint.vectors(angles, turning.means))[:, 0]
    back = np.linalg.pinv(slopes, rcond=1e-3)
    known = np.ones(len(true), dtype=bool)
    stretch = Stretch(np.arange(len(true)) / FPS, angles, SIGMA**2 * back @ back.transpose(0, 2, 1), known)
    (plain,) = RauchTungStriebel().smooth([stretch])
    (turned,) = RauchTungStriebel().smooth([turning.vectors_of(stretch)])
    raw, plain_off, off = (
        float(np.sqrt(np.mean((rotation_of(joint, poses).inv() * true).magnitude() ** 2)))
        for poses in (angles, plain.poses, turning.angles_of(turned, stretch).poses)
    )
    assert off < 0.6 * raw
    assert plain_off > 1.5 * off


def test_what_turns_evenly_is_predicted_through_gimbal_lock(body: BodyModel) -> None:
    """A constant acceleration of angles is none of the arm there."""
    columns = body.ball_joints.columns[BALLS.index("left_arm")]
    arm = BallJoints(np.array([[0, 1, 2]]), body.ball_joints.axes[[BALLS.index("left_arm")]])
    even = Rotation.from_rotvec(np.outer(np.linspace(-0.5, 0.5, 26), [0.7, 0.1, 0.6]))
    raised = Rotation.from_matrix(arm.rotations(np.array([0.0, np.radians(-80.0), 0.0]))[0]) * even
    angles, near = np.zeros((len(even), 3)), np.array([[0.0, np.radians(-80.0), 0.0]])
    for t, vector in enumerate(raised.as_rotvec()):
        angles[t] = near = arm.with_angles(vector[None, None], np.eye(3)[None], near)
    poses = np.tile(body.rest(), (len(even), 1))
    poses[:, columns] = angles
    poses = body.clamped(poses)
    wrist = body.landmark_names.index("left_wrist")
    inside = np.flatnonzero((np.abs(poses[:, columns] - angles) < 1e-9).all(axis=1))
    gaps = []
    for t in inside[(inside >= 5) & np.isin(inside - 5, inside)]:
        history = History(np.arange(t - 5, t) / FPS, poses[t - 5 : t])
        found = PolynomialPrediction(candidates=False).predict(body, history, t / FPS)
        gaps.append(np.linalg.norm(np.diff(body.landmarks_in_world(np.array([poses[t], found[0]]))[:, wrist], axis=0)))
    assert len(gaps) > 8
    assert max(gaps) < 1e-3
