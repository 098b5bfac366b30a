"""Bodies that run through themselves cost more; those that only touch do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tracker.body import BodyModel
from tracker.body_files import load_body
from tracker.geometry.superquadrics import inside_outside
from tracker.observation import Observation
from tracker.resources import model_path
from tracker.scene import Scene
from tracker.simulation.sequence import Recipe, simulate

from observations import objective_of  # isort: skip


def crossed(body: BodyModel) -> np.ndarray:
    """Legs that run through each other."""
    q = body.rest()
    q[[body.index("left_leg_abduction"), body.index("right_leg_abduction")]] = -0.5
    return body.clamped(q)


def plain(body: BodyModel, q: np.ndarray) -> int:
    """The twin: every point against every part, by the inside-outside function."""
    placed, count = body.world_from_part(q), 0
    for pair in body.apart:
        for p, other in (pair, pair[::-1]):
            axis = np.linspace(-0.8, 0.8, 5)[:, None] * [0, 0, body.parts[p].shape.size[2]]
            world = axis @ placed[p, :3, :3].T + placed[p, :3, 3]
            local = (world - placed[other, :3, 3]) @ placed[other, :3, :3]
            count += int((inside_outside(body.parts[other].shape.packed, local) < 1).sum())
    return count


def test_counts_are_those_of_the_plain_twin(body: BodyModel) -> None:
    low, high = np.maximum(body.limits[:, 0], -1), np.minimum(body.limits[:, 1], 1)
    poses = np.random.default_rng(0).uniform(low, high, (40, body.dof))
    counts = body.collisions(poses)
    assert counts.max() > 3
    np.testing.assert_array_equal(counts, [plain(body, q) for q in poses])
    np.testing.assert_array_equal(counts[:1], body.collisions(poses[:1]))


@pytest.mark.parametrize("movement", ["two_elbow_rotation", "walking_on_the_spot", "arm_swing", "squat", "turn"])
def test_movements_of_people_are_free(body: BodyModel, movement: str) -> None:
    assert body.collisions(simulate(Recipe(movement, seconds=2.0)).poses[0]).max() == 0


@pytest.mark.parametrize("name", ["gavrila22", "quadruped"])
def test_the_reference_pose_is_free_and_neighbours_are_left_out(name: str) -> None:
    body = load_body(model_path(name))
    assert body.collisions(body.rest()[None])[0] == 0
    assert len(body.apart) > 40
    ends = body.part_parameters[body.apart]
    assert (ends[:, 0] != ends[:, 1]).all()


def test_a_body_that_runs_through_itself_is_farther_off(truth: Scene, observation: Observation) -> None:
    objective = objective_of(truth, observation)
    poses = np.array([crossed(objective.body), truth.persons[0].q])
    free, points = replace(objective, collision_px=0.0), objective.body.collisions(poses)[0]
    assert points > 0
    np.testing.assert_allclose(objective(poses) - free(poses), [min(0.1 * points, 0.5), 0.0])
    uncapped = replace(objective, most_collision_px=1e6)
    np.testing.assert_allclose(uncapped(poses) - free(poses), [0.1 * points, 0.0])


def test_no_end_of_points_outvotes_the_images(truth: Scene, observation: Observation) -> None:
    """A leg in its place that runs through the other one is better than one that is free and elsewhere."""
    objective = objective_of(truth, observation)
    elsewhere = truth.persons[0].q.copy()
    elsewhere[objective.body.index("left_leg_abduction")] += np.radians(40)
    distances = replace(objective, collision_px=0.0)(np.array([truth.persons[0].q, elsewhere]))
    assert distances[1] - distances[0] > objective.most_collision_px
