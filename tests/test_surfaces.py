"""Poses of persons whose own surface is known are judged by it, searches live on the parts that stand for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from observations import bent, four_views, observed
from test_skins import meshed

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Person, Scene
from tracker.cameras.frame import Frame
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.regions import RegionEvidence
from tracker.foundation.arrays import Array
from tracker.images.sight import Sight
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.estimation.hybrid import HybridEstimation
from tracker.tracking.objective import Objective

CPU = CpuSynthesis()


@pytest.fixture(scope="module")
def scene(body: BodyModel) -> Scene:
    """A person a fifth thicker than the parts that are searched with."""
    dressed = meshed(body)
    assert dressed.skin is not None
    centres = dressed.model_from_parts[:, :3, 3].repeat(len(dressed.skin.points) // len(body.parts), axis=0)
    wide = replace(dressed.skin, points=centres + 1.2 * (dressed.skin.points - centres))
    return Scene((Person("one", replace(dressed, skin=wide), bent(body)),), four_views())


@pytest.fixture(scope="module")
def objective(scene: Scene) -> Objective:
    """Of images in which the edges are those of the surface."""
    return Objective(Comparison(scene, 0, CPU, observed(CPU.contours(scene), scene.rig)), ContourEvidence())


def near(scene: Scene) -> Array:
    q = scene.persons[0].q
    return np.stack([q, q + np.radians(2.0) * scene.persons[0].body.rotates])


def test_the_right_pose_is_explained_by_the_surface_and_not_by_the_parts(scene: Scene, objective: Objective) -> None:
    of_parts, of_surface = objective(near(scene)), objective.by_surface()(near(scene))
    assert of_surface[0] < 0.5 < of_parts[0]
    assert of_surface[0] < of_surface[1] - 0.5


def test_its_number_is_that_of_its_estimate(scene: Scene, objective: Objective) -> None:
    judge, q = objective.by_surface(), scene.persons[0].q
    distance_px = float(judge(q[None])[0])
    assert objective.by_surface().estimate(q, np.eye(len(q)), 0).distance_px == pytest.approx(distance_px, abs=1e-9)


def test_searches_ask_the_parts(scene: Scene, objective: Objective) -> None:
    poses = near(scene)
    np.testing.assert_array_equal(objective.by_surface().by_parts()(poses), objective(poses))
    assert objective.by_parts() is objective


def test_what_was_found_is_told_by_the_surface(scene: Scene, objective: Objective) -> None:
    judge = objective.by_surface()
    found = HybridEstimation(search=True, rounds=1).estimate(judge, near(scene))
    assert found.distance_px == pytest.approx(float(judge(found.q[None])[0]), abs=1e-9)
    assert found.distance_px < 0.5


def test_without_a_surface_nothing_changes(scene: Scene, objective: Objective) -> None:
    person = scene.persons[0]
    bare = Scene((replace(person, body=replace(person.body, skin=None)),), scene.rig)
    question = objective.about(bare, 0)
    assert question.by_surface() is question


def test_colours_are_compared_beside_the_surface(scene: Scene) -> None:
    """A green person before a grey wall explains its colours by its surface; parts lie a fifth inside of it."""
    images = []
    for mask in CPU.silhouettes(scene):
        image = np.where(mask[..., None], (60, 120, 70), (170, 165, 160))
        images.append(np.asarray(image, dtype=np.uint8))
    sight, evidence, contours = Sight(Frame(0, 0.0, tuple(images))), RegionEvidence(), CPU.contours(scene)
    memory = evidence.learned(
        None, sight, scene, contours, np.ones((len(scene.rig), len(scene.shapes)), dtype=np.bool_)
    )
    asked = Comparison(scene, 0, CPU, evidence.observe(sight, contours, memory))
    question, q = Objective(asked, evidence, collision_px=0.0), scene.persons[0].q
    assert float(question.by_surface()(q[None])[0]) < 0.7 * float(question(q[None])[0])
