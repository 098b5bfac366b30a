"""Neighbouring starts lead out of local minima, and never to a worse pose."""

from __future__ import annotations

import numpy as np
import pytest
from observations import bent, four_views, ideal, joint_errors_mm, objective_of

from tracker.bodies.body import BodyModel
from tracker.bodies.limbs import scattered
from tracker.bodies.scene import Person, Scene
from tracker.foundation.arrays import Array
from tracker.images.sight import Observation
from tracker.tracking.estimate import Estimate
from tracker.tracking.estimation.neighbours import NeighboursEstimation
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.objective import Objective


@pytest.fixture(scope="module")
def large_truth(body: BodyModel) -> Scene:
    """In images of 720 x 576: leads are in pixels."""
    return Scene((Person("one", body, bent(body)),), four_views((720, 576)))


@pytest.fixture(scope="module")
def large_observation(large_truth: Scene) -> Observation:
    return ideal(large_truth)


class Found:
    """An estimation that stays at its first start."""

    def estimate(self, objective: Objective, starts: Array) -> Estimate:
        return objective.estimate(starts[0], np.eye(starts.shape[1]), 7)


def turned(body: BodyModel, q: Array, limb: str, angle_deg: float) -> Array:
    pose: Array = q.copy()
    pose[body.index(f"{limb}_elevation")] += np.radians(angle_deg)
    return body.clamped(pose)


@pytest.mark.parametrize("limb", ["left_arm", "right_arm", "left_leg", "right_leg"])
def test_neighbours_find_what_the_refinement_misses(
    large_truth: Scene, large_observation: Observation, limb: str
) -> None:
    """Limbs 30 and 40 degrees off: the refinement alone finds none of them, neighbours found 12 of 16."""
    body, q = large_truth.persons[0].body, large_truth.persons[0].q
    refined, tried = [], []
    for angle_deg in (-40.0, -30.0, 30.0, 40.0):
        start = turned(body, q, limb, angle_deg)
        objective = objective_of(large_truth.with_pose(0, start), large_observation)
        alone = TwistIcpEstimation().estimate(objective, start[None])
        both = NeighboursEstimation(of=TwistIcpEstimation()).estimate(objective, start[None])
        assert both.distance_px <= alone.distance_px
        refined.append(joint_errors_mm(body, alone.q, q).max() < 5)
        tried.append(joint_errors_mm(body, both.q, q).max() < 5)
    assert not any(refined)
    assert sum(tried) >= 2


def test_a_limb_that_the_images_show_has_no_neighbours_tried(truth: Scene, observation: Observation) -> None:
    objective, q = objective_of(truth, observation), truth.persons[0].q
    found = NeighboursEstimation(of=Found()).estimate(objective, q[None])
    np.testing.assert_array_equal(found.q, q)
    assert found.evaluations == 7


def test_what_is_clearly_better_is_taken(truth: Scene, observation: Observation) -> None:
    body, q = truth.persons[0].body, truth.persons[0].q
    start, objective = turned(body, q, "left_arm", 50.0), objective_of(truth, observation)
    goes = NeighboursEstimation(of=Found()).estimate(objective, start[None])
    assert goes.distance_px < objective(start[None])[0] - 0.1
    assert joint_errors_mm(body, goes.q, q).max() < joint_errors_mm(body, start, q).max()


def test_scattered_poses_lie_around_their_centres(body: BodyModel) -> None:
    q, columns = bent(body), body.group("left_arm")
    other = q.copy()
    other[columns] += 0.3
    centres = np.array([q, body.clamped(other)])
    poses = scattered(body, centres, "left_arm", 64, (0.05, 0.01))
    rest = np.setdiff1d(np.arange(body.dof), columns)
    np.testing.assert_array_equal(poses[:, rest], np.tile(q[rest], (64, 1)))
    np.testing.assert_array_equal(poses, body.clamped(poses))
    for k, centre in enumerate(centres):
        offsets = poses[32 * k : 32 * k + 32][:, columns] - centre[columns]
        # Halton's points fill the distribution; limits cut some of it off
        assert (np.abs(offsets.mean(axis=0)) < 0.03).all()
        assert (offsets.std(axis=0) < 0.07).all()
        assert offsets.std(axis=0).max() > 0.03
    np.testing.assert_array_equal(poses, scattered(body, centres, "left_arm", 64, (0.05, 0.01)))
