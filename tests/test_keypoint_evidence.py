"""Keypoints as evidence: equations against finite differences, faults of detectors, and views that are missing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from detected import detected, exchanged, written
from observations import bent, four_views

from tracker.arrays import Array
from tracker.body import BodyModel
from tracker.comparison import Comparison
from tracker.evidence.keypoints import KeypointEvidence
from tracker.frame import Frame
from tracker.scene import Person, Scene
from tracker.sight import Sight
from tracker.synthesis.cpu import CpuSynthesis


@pytest.fixture(scope="module")
def scene(body: BodyModel) -> Scene:
    return Scene((Person("one", body, bent(body)),), four_views((720, 576)))


def ask(scene: Scene, views: list[Array], folder: Path, missing: int = 0) -> tuple[KeypointEvidence, Comparison]:
    evidence = KeypointEvidence(path=written(views, scene.rig.names, folder))
    images = tuple(None if v < missing else np.zeros((576, 720, 3), np.uint8) for v in range(4))
    return evidence, Comparison(scene, 0, CpuSynthesis(), evidence.observe(Sight(Frame(0, 0.0, images)), None))


def refined(evidence: KeypointEvidence, asked: Comparison, q: Array, n_steps: int = 8) -> Array:
    body = asked.body
    for _ in range(n_steps):
        found = evidence.equations(asked, q, 20.0)
        prior = np.diag(np.where(body.rotates, 1 / np.radians(60), 1.0) ** 2)
        q = body.clamped(q - np.linalg.solve(found.matrix + prior, found.vector))
    return q


def off_mm(body: BodyModel, q: Array, truth: Array) -> Array:
    """(L,) distances of the landmarks."""
    gaps: Array = 1000 * np.linalg.norm(body.landmarks_in_world(q) - body.landmarks_in_world(truth), axis=1)
    return gaps


def test_equations_are_those_of_finite_differences(scene: Scene, tmp_path: Path) -> None:
    """With keypoints a little off, so that weights hardly change along the way."""
    evidence, asked = ask(scene, detected(scene, noise_px=0.2), tmp_path)
    body, q = asked.body, scene.persons[0].q
    found = evidence.equations(asked, q, 20.0)

    def pixels(pose: Array) -> Array:
        return evidence._matched(asked, pose[None]).gaps[0]

    matched = evidence._matched(asked, q[None])
    weights = np.repeat((matched.weights / (0.03 * matched.px_per_m) ** 2)[0][..., None], 2, axis=-1).ravel()
    step = 1e-5
    jacobian = np.stack([(pixels(q + d) - pixels(q - d)).ravel() / (2 * step) for d in step * np.eye(body.dof)], axis=1)
    matrix = jacobian.T @ (weights[:, None] * jacobian)
    np.testing.assert_allclose(found.matrix, matrix, rtol=0.005, atol=1e-3 * matrix.max())
    vector = jacobian.T @ (weights * pixels(q).ravel())
    np.testing.assert_allclose(found.vector, vector, atol=0.02 * np.abs(vector).max())
    assert found.total == pytest.approx(weights.sum(), rel=0.005)


def swap_a_view(views: list[Array]) -> None:
    views[1] = exchanged(views[1], ("left", "right"))


def swap_legs(views: list[Array]) -> None:
    views[2] = exchanged(views[2], ("hip", "knee", "ankle"))


def add_false_person(views: list[Array]) -> None:
    coat = np.random.default_rng(3).uniform(50, 500, (1, 17, 3))
    views[0] = np.concatenate([coat, views[0]])


def misplace_a_wrist(views: list[Array]) -> None:
    views[1][0, 9, :2] += 150


@pytest.mark.parametrize("fault", [swap_a_view, swap_legs, add_false_person, misplace_a_wrist])
def test_a_refinement_finds_back_in_spite_of_faults(
    fault: Callable[[list[Array]], None], scene: Scene, tmp_path: Path
) -> None:
    views = detected(scene, noise_px=1.0)
    fault(views)
    evidence, asked = ask(scene, views, tmp_path)
    body, truth = asked.body, scene.persons[0].q
    rng = np.random.default_rng(0)
    start = body.clamped(truth + np.where(body.rotates, np.radians(8), 0.04) * rng.choice([-1, 1], body.dof))
    assert off_mm(body, start, truth).max() > 80
    marks = [k for k, name in enumerate(body.landmark_names) if name.endswith(("wrist", "ankle", "knee", "elbow"))]
    assert off_mm(body, refined(evidence, asked, start), truth)[marks].max() < 25


def test_a_batch_is_its_poses_one_by_one(scene: Scene, tmp_path: Path) -> None:
    views = detected(scene, noise_px=3.0)
    swap_legs(views)
    add_false_person(views)
    evidence, asked = ask(scene, views, tmp_path)
    body = asked.body
    poses = body.clamped(scene.persons[0].q + 0.1 * np.random.default_rng(1).normal(size=(5, body.dof)))
    singles = [evidence.distances(asked, q[None])[0] for q in poses]
    np.testing.assert_allclose(evidence.distances(asked, poses), singles)


def test_missing_views_and_nobody_say_nothing(scene: Scene, tmp_path: Path) -> None:
    evidence, asked = ask(scene, [view[:0] for view in detected(scene)], tmp_path / "nobody")
    q = scene.persons[0].q
    assert evidence.equations(asked, q, 20.0).total == 0
    assert not evidence.account(asked, q).visible_px.any()
    evidence, asked = ask(scene, detected(scene), tmp_path / "one", missing=3)
    account = evidence.account(asked, q)
    np.testing.assert_array_equal(np.isnan(account.per_view_px), [True, True, True, False])
