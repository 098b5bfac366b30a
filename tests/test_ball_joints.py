"""Joints that turn about three axes: the same rotations as vectors and as angles, and smooth in gimbal lock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.foundation.resources import model_path
from tracker.results.smoothing import BallJoint, Smoothed, Stretch, ball_joints, with_angles, with_vectors
from tracker.results.smoothing.rts import RauchTungStriebel

FPS = 50.0
SIGMA = np.radians(1.0)


@pytest.fixture(scope="module")
def body() -> BodyModel:
    return load_body(model_path("human"))


def moved(body: BodyModel, n: int = 40, size: float = 0.4, seed: int = 0) -> np.ndarray:
    """All joints swing about the rest pose, whatever their limits."""
    phases = np.random.default_rng(seed).uniform(0, 6, body.dof)
    return np.asarray(body.rest() + size * np.sin(np.arange(n)[:, None] / 6 + phases) * body.rotates)


def stretch_of(poses: np.ndarray, known: np.ndarray | None = None) -> Stretch:
    n, dof = poses.shape
    known = np.ones(n, dtype=bool) if known is None else known
    rng = np.random.default_rng(1)
    mixing = rng.normal(size=(dof, dof)) / np.sqrt(dof)
    covariance = SIGMA**2 * (mixing @ mixing.T + np.eye(dof))
    return Stretch(np.arange(n) / FPS, np.where(known[:, None], poses, np.nan), np.tile(covariance, (n, 1, 1)), known)


def unchanged(stretch: Stretch, poses: np.ndarray) -> Smoothed:
    zeros = np.zeros_like(poses)
    return Smoothed(poses, zeros, zeros, stretch.covariances)


def test_joints_are_those_with_three_angles(body: BodyModel) -> None:
    joints = ball_joints(body, moved(body))
    names = {body.names[joint.columns[0]].rpartition("_")[0] for joint in joints}
    assert names == {"torso", "spine", "neck", "left_arm", "right_arm", "left_leg", "right_leg"}
    for joint in joints:
        np.testing.assert_allclose(np.linalg.norm(joint.axes, axis=1), 1.0)


def test_rotations_are_those_of_the_body(body: BodyModel) -> None:
    poses = moved(body)
    (joint,) = (one for one in ball_joints(body, poses) if body.names[one.columns[0]] == "torso_abduction")
    hand = [part.name for part in body.parts].index("pelvis")
    placed = body.world_from_part(poses)[:, hand, :3, :3] @ body.model_from_parts[hand, :3, :3].T
    np.testing.assert_allclose(joint.rotations(poses[:, list(joint.columns)]).as_matrix(), placed, atol=1e-9)


def test_slopes_are_finite_differences(body: BodyModel) -> None:
    poses, h = moved(body, size=0.8), 1e-6
    for joint in ball_joints(body, poses):
        angles = poses[:, list(joint.columns)]
        slopes = joint.slopes(angles)
        for k in range(3):
            step = h * np.eye(3)[k]
            expected = (joint.vectors(angles + step) - joint.vectors(angles - step)) / (2 * h)
            np.testing.assert_allclose(slopes[..., k], expected, atol=1e-6)


def test_vectors_and_back_are_the_same_movement(body: BodyModel) -> None:
    poses = moved(body, size=0.8)
    known = np.ones(len(poses), dtype=bool)
    known[10:13] = False
    stretch = stretch_of(poses, known)
    joints = ball_joints(body, poses[known])
    there = with_vectors(stretch, joints)
    assert np.isnan(there.poses[~known]).all()
    filled = np.where(known[:, None], there.poses, with_vectors(stretch_of(poses), joints).poses)
    back = with_angles(unchanged(there, filled), joints, stretch)
    np.testing.assert_allclose(back.poses, poses, atol=1e-6)
    columns = np.concatenate([joint.columns for joint in joints])
    rates = np.gradient(poses, 1 / FPS, axis=0)
    np.testing.assert_allclose(back.velocities[5:-5, columns], rates[5:-5, columns], atol=0.1)
    lone = np.setdiff1d(np.arange(body.dof), columns)
    sigmas = np.sqrt(np.diagonal(back.covariances, axis1=1, axis2=2))
    assert (sigmas[known] > 0.95 * stretch.sigmas[known]).all()
    np.testing.assert_allclose(sigmas[np.ix_(known, lone)], stretch.sigmas[np.ix_(known, lone)])


@pytest.mark.parametrize("off_deg", [0.0, 0.05, 0.3, 1.0, 3.0, 10.0, 40.0])
def test_angles_that_gimbal_lock_hides_are_not_known_afterwards(off_deg: float) -> None:
    """A rotation known to half a degree, angles within 15: also without any smoothing, angles are not surer than so."""
    joint, angles = (
        BallJoint((0, 1, 2), np.eye(3), np.eye(3)),
        np.tile([0.3, np.pi / 2 - np.radians(off_deg), 0.2], (9, 1)),
    )
    joint = replace(joint, mean=joint.rotations(angles).mean().as_matrix())
    slopes = joint.slopes(angles)
    told = np.linalg.inv(slopes.transpose(0, 2, 1) @ slopes / np.radians(0.5) ** 2 + np.eye(3) / np.radians(15) ** 2)
    known = np.arange(9) != 4
    covariances = np.where(known[:, None, None], told, np.nan)
    stretch = Stretch(np.arange(9) / FPS, np.where(known[:, None], angles, np.nan), covariances, known)
    there = with_vectors(replace(stretch, poses=angles, covariances=told, known=np.ones(9, dtype=bool)), [joint])
    back = with_angles(unchanged(there, there.poses), [joint], stretch)
    sigmas = np.sqrt(np.diagonal(back.covariances, axis1=1, axis2=2) / np.diagonal(told, axis1=1, axis2=2))
    assert ((sigmas > 0.7) & (sigmas < 1.05)).all()


@pytest.mark.parametrize("turns", [0.9, 1.5, -2.0])
def test_whoever_turns_on_the_spot_keeps_the_angles(body: BodyModel, turns: float) -> None:
    poses = moved(body)
    poses[:, body.root.turn] = np.linspace(0, 2 * np.pi * turns, len(poses))
    columns = {joint.columns for joint in ball_joints(body, poses)}
    assert columns == {joint.columns for joint in ball_joints(body, moved(body))} - {
        next(joint.columns for joint in ball_joints(body, moved(body)) if body.root.turn in joint.columns)
    }


def test_a_joint_is_smooth_in_gimbal_lock() -> None:
    """An arm goes by the direction in which its first and last axis are one; the noise is that of its rotations."""
    joint = BallJoint((0, 1, 2), np.eye(3), np.eye(3))
    n, rng = 80, np.random.default_rng(2)
    swing = np.linspace(-1, 1, n)
    true = Rotation.from_rotvec(np.stack([0.15 * swing, np.full(n, np.pi / 2 - 0.02), 0.9 * swing], axis=1))
    seen = true * Rotation.from_rotvec(SIGMA * rng.normal(size=(n, 3)))
    angles, near = np.zeros((n, 3)), np.array([0.0, 1.4, 0.0])
    for t in range(n):
        angles[t] = near = joint.angles(seen[t].as_rotvec()[None], near[None])[0]
    np.testing.assert_allclose((joint.rotations(angles).inv() * seen).magnitude(), 0, atol=1e-3)
    assert np.abs(np.diff(angles, axis=0)).max() > 0.2  # that is the lock
    back = np.linalg.pinv(joint.slopes(angles), rcond=1e-3)
    stretch = Stretch(np.arange(n) / FPS, angles, SIGMA**2 * back @ back.transpose(0, 2, 1), np.ones(n, dtype=bool))
    smoothing = RauchTungStriebel()
    (plain,) = smoothing.smooth([stretch])
    (turned,) = smoothing.smooth([with_vectors(stretch, [joint])])
    smooth = with_angles(turned, [joint], stretch)
    off = {
        name: np.sqrt(np.mean((joint.rotations(poses).inv() * true).magnitude() ** 2))
        for name, poses in (("raw", angles), ("plain", plain.poses), ("smooth", smooth.poses))
    }
    assert off["smooth"] < 0.6 * off["raw"]
    assert off["plain"] > 2 * off["smooth"]
