"""Rigid motions between points: exact ones found, none nearer, never a reflection, defined where points tell little."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tracker.foundation.geometry import rigid_motion


def motion_of(seed: int) -> np.ndarray:
    """(4, 4) of any turn and shift."""
    motion = np.eye(4)
    motion[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    motion[:3, 3] = np.random.default_rng(seed).normal(size=3)
    return motion


def moved(motion: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ motion[:3, :3].T + motion[:3, 3]


def scattered(n: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(n, 3))


def assert_proper(motion: np.ndarray) -> None:
    np.testing.assert_allclose(motion[:3, :3] @ motion[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(motion[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_array_equal(motion[3], [0.0, 0.0, 0.0, 1.0])


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("n", [3, 4, 50])
def test_an_exact_motion_is_found(n, seed):
    points, wanted = scattered(n, seed), motion_of(seed)
    np.testing.assert_allclose(rigid_motion(points, moved(wanted, points)), wanted, atol=1e-12)


def test_points_in_a_plane_are_enough():
    """A floor board: the reflection in its plane fits as well and is not meant."""
    board = np.stack([*np.meshgrid(np.arange(4.0), np.arange(3.0)), np.zeros((3, 4))], axis=-1).reshape(-1, 3)
    for seed in range(20):
        wanted = motion_of(seed)
        np.testing.assert_allclose(rigid_motion(board, moved(wanted, board)), wanted, atol=1e-12)


def test_none_is_nearer():
    points = scattered(30)
    targets = moved(motion_of(1), points) + 0.2 * scattered(30, 2)
    found = rigid_motion(points, targets)

    def off(motion: np.ndarray) -> float:
        return float(((moved(motion, points) - targets) ** 2).sum())

    for seed in range(50):
        nudge = np.eye(4)
        nudge[:3, :3] = Rotation.from_rotvec(0.02 * scattered(1, seed)[0]).as_matrix()
        nudge[:3, 3] = 0.02 * scattered(1, seed + 100)[0]
        assert off(nudge @ found) > off(found)


def test_a_point_counts_as_often_as_it_is_given():
    """By the weighted fit of another library."""
    points = scattered(8)
    targets, counts = moved(motion_of(1), points) + 0.3 * scattered(8, 2), np.arange(1, 9)
    found = rigid_motion(np.repeat(points, counts, axis=0), np.repeat(targets, counts, axis=0))
    middle, there = np.average(points, axis=0, weights=counts), np.average(targets, axis=0, weights=counts)
    rotation, _ = Rotation.align_vectors(targets - there, points - middle, weights=counts)
    np.testing.assert_allclose(found[:3, :3], rotation.as_matrix(), atol=1e-9)
    np.testing.assert_allclose(moved(found, middle), there, atol=1e-12)


def test_mirrored_points_are_turned_and_not_mirrored():
    points = scattered(20)
    found = rigid_motion(points, points * (1.0, 1.0, -1.0))
    assert_proper(found)
    assert np.abs(moved(found, points) - points * (1.0, 1.0, -1.0)).max() > 0.1


def test_points_that_are_not_known_are_left_out():
    points, wanted = scattered(12), motion_of(3)
    targets = moved(wanted, points)
    points[1, 2], targets[5] = np.nan, np.nan
    np.testing.assert_allclose(rigid_motion(points, targets), wanted, atol=1e-12)


@pytest.mark.parametrize(
    "points", [scattered(1), np.repeat(scattered(1), 3, axis=0), np.outer([-1.0, 0, 2, 5], [1, 2, 3])]
)
def test_points_that_tell_no_turn_are_brought_there_all_the_same(points):
    """Three samples drawn at random may be one place, and a row of them a line."""
    targets = moved(motion_of(4), points)
    found = rigid_motion(points, targets)
    assert_proper(found)
    np.testing.assert_allclose(moved(found, points), targets, atol=1e-12)
