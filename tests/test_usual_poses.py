"""Where images hardly tell, a pose is as usual as they allow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from observations import ideal, joint_errors_mm, objective_of

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.bodies.scene import Scene
from tracker.evidence.measures.correspondences import Equations
from tracker.foundation.arrays import Array
from tracker.foundation.resources import model_path
from tracker.images.sight import Observation
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation


def with_usual(body: BodyModel, spreads_deg: dict[str, float]) -> BodyModel:
    changed = [replace(p, spread=np.radians(spreads_deg.get(p.name, np.inf))) for p in body.parameters]
    return replace(body, parameters=tuple(changed))


def drawn(truth: Scene, spreads_deg: dict[str, float]) -> Scene:
    """The scene with a body that is usually at rest in some of its parameters."""
    person = truth.persons[0]
    return truth.with_bodies({0: with_usual(person.body, spreads_deg)}).with_pose(0, person.q)


@pytest.fixture(scope="module")
def human() -> BodyModel:
    return load_body(model_path("human"))


def test_rarity_counts_standard_deviations_from_rest(human: BodyModel) -> None:
    collar, elbow = human.index("left_collar_protraction"), human.index("left_arm_extension")
    poses = np.tile(human.rest(), (3, 1))
    poses[1, collar] += 2 * human.spreads[collar]
    poses[2, elbow] += 1.0
    np.testing.assert_allclose(human.rarity(poses), [0, 4, 0], atol=1e-12)
    assert float(human.rarity(poses[1])) == pytest.approx(4)


def test_both_sides_of_a_person_are_as_usual(human: BodyModel) -> None:
    names = {p.name: p.spread for p in human.parameters if np.isfinite(p.spread)}
    assert names
    assert {human.mirror.of(name): spread for name, spread in names.items()} == names


def test_a_pull_is_the_gradient_of_what_an_unusual_pose_costs(truth: Scene, observation: Observation) -> None:
    """The equations minimize squares; near a pose that is left over by its root mean square these change as px do."""
    scene = drawn(truth, {"left_arm_elevation": 12.0, "right_arm_twist": 30.0})
    body, q = scene.persons[0].body, scene.persons[0].q
    objective = replace(objective_of(scene, observation), collision_px=0.0)
    plain = replace(objective, rare_px=0.0).equations(q, 30.0)
    pulled = objective.equations(q, 30.0)
    per_px = 2 * np.sqrt(plain.squares * plain.total)
    gradient = np.array(
        [np.diff(objective.penalties(q + np.outer([-1e-4, 1e-4], row)))[0] / 2e-4 for row in np.eye(body.dof)]
    )
    np.testing.assert_allclose(2 * (pulled.vector - plain.vector), per_px * gradient, atol=1e-6 * per_px)
    assert np.abs(gradient).max() > 1e-3
    assert (pulled.squares, pulled.total) == (plain.squares, plain.total)


def test_a_pull_alone_leads_to_where_it_pulls() -> None:
    offsets, weights = np.array([0.3, -0.2, 0.1]), np.array([2.0, 0.5, 0.0])
    found = Equations.nothing(3).pulled(weights, offsets)
    step: Array = np.linalg.lstsq(found.matrix, -found.vector, rcond=None)[0]
    np.testing.assert_allclose(offsets + step, [0, 0, 0.1], atol=1e-12)


def test_what_images_show_is_hardly_moved(truth: Scene, observation: Observation) -> None:
    """Elbows 40 and 70 degrees from rest, one and two standard deviations: the contours hold them."""
    scene = drawn(truth, dict.fromkeys(("left_arm_extension", "right_arm_extension"), 40.0))
    body, q = scene.persons[0].body, scene.persons[0].q
    objective = objective_of(scene, observation)
    with_pull = TwistIcpEstimation().estimate(objective, q[None])
    without = TwistIcpEstimation().estimate(replace(objective, rare_px=0.0), q[None])
    assert joint_errors_mm(body, with_pull.q, without.q).max() < 3


def test_what_no_image_shows_is_as_usual(truth: Scene, observation: Observation) -> None:
    """A forearm turns about its long axis unseen: a superquadric of round girth looks the same."""
    name = "left_arm_twist"
    straight = truth.persons[0].q.copy()
    scene = drawn(truth, {name: 10.0})
    body = scene.persons[0].body
    twist, bend = body.index(name), body.index("left_arm_extension")
    straight[[twist, bend]] = np.radians([30.0, 0.0])
    scene = scene.with_pose(0, straight)
    seen = ideal(scene)
    found = TwistIcpEstimation().estimate(objective_of(scene, seen), straight[None])
    free = TwistIcpEstimation().estimate(replace(objective_of(scene, seen), rare_px=0.0), straight[None])
    assert abs(np.degrees(found.q[twist])) < 8
    assert abs(np.degrees(free.q[twist])) > 20
