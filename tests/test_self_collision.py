"""Bodies that run through themselves cost more; those that only touch do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rounding import SINGLE, assert_alike

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.bodies.scene import Scene
from tracker.foundation.geometry.superquadrics import inside_outside
from tracker.foundation.resources import model_path
from tracker.images.sight import Observation
from tracker.kernels.body import depth
from tracker.synthesis.simulation.sequence import Recipe, simulate

from observations import objective_of  # isort: skip


def crossed(body: BodyModel) -> np.ndarray:
    """Legs that run through each other."""
    q = body.rest()
    q[[body.index("left_leg_abduction"), body.index("right_leg_abduction")]] = -0.5
    return body.clamped(q)


def plain(body: BodyModel, q: np.ndarray) -> float:
    """The twin: every point against every part, its depth by steps towards the surface across the part."""
    placed, total = body.world_from_part(q), 0.0
    for pair in body.apart:
        for p, other in (pair, pair[::-1]):
            axis = np.linspace(-0.8, 0.8, 5)[:, None] * [0, 0, body.parts[p].shape.size[2]]
            world = axis @ placed[p, :3, :3].T + placed[p, :3, 3]
            local = (world - placed[other, :3, 3]) @ placed[other, :3, :3]
            shape = body.parts[other].shape.packed
            total += sum(min(plain_depth(shape, point) / 0.25, 1.0) for point in local)
    return total


def plain_depth(shape: np.ndarray, point: np.ndarray) -> float:
    """How much longer the way from the axis to the surface is than to the point, over the way to the surface."""
    if inside_outside(shape, point[None])[0] >= 1:
        return 0.0
    near, far = 1.0, 1e6
    for _ in range(80):
        middle = np.sqrt(near * far)
        inside = inside_outside(shape, (point * [middle, middle, 1.0])[None])[0] < 1
        near, far = (middle, far) if inside else (near, middle)
    return 1 - 1 / near


def test_collisions_are_those_of_the_plain_twin(body: BodyModel) -> None:
    low, high = np.maximum(body.limits[:, 0], -1), np.minimum(body.limits[:, 1], 1)
    poses = np.random.default_rng(0).uniform(low, high, (40, body.dof))
    sums = body.collisions(poses)
    assert sums.max() > 3
    np.testing.assert_allclose(sums, [plain(body, q) for q in poses], atol=1e-3)
    assert_alike(sums[:1], body.collisions(poses[:1]), SINGLE)


def test_a_depth_is_the_share_of_the_radius() -> None:
    shape = np.array([0.12, 0.16, 0.2, 0.5, 1.0, 0.0, 0.0])
    depths = [depth(shape, 1 - inwards / 0.12, 0.0, 0.0) for inwards in (0.0, 0.01, 0.03, 0.06, 0.12)]
    np.testing.assert_allclose(depths, [0, 1 / 12, 0.25, 0.5, 1], atol=1e-9)


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
