"""Keypoints as evidence: equations against finite differences, faults of detectors, and views that are missing."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from detected import NAMES, detected, exchanged, written
from observations import bent, four_views

from tracker.bodies.body import BodyModel
from tracker.bodies.keypoint_layouts.orders import LAYOUTS
from tracker.bodies.keypoints import limbs, meant, swapped_sides
from tracker.bodies.scene import Person, Scene
from tracker.cameras.frame import Frame
from tracker.evidence.auto import AutoEvidence
from tracker.evidence.keypoints import KeypointEvidence
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.together import TogetherEvidence
from tracker.foundation.arrays import Array
from tracker.foundation.errors import ConfigError
from tracker.images.sight import Sight
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


def test_matches_are_those_of_trying_every_way(scene: Scene, tmp_path: Path) -> None:
    """The kernel beside a plain search over all detections of a view and all sets of limbs exchanged."""
    views = detected(scene, noise_px=8.0)
    for fault in (swap_legs, add_false_person, misplace_a_wrist):
        fault(views)
    evidence, asked = ask(scene, views, tmp_path)
    body = asked.body
    q = body.clamped(scene.persons[0].q + 0.15 * np.random.default_rng(5).normal(size=body.dof))
    matched = evidence._matched(asked, q[None])
    known, partner, groups = meant(NAMES, body), swapped_sides(NAMES, body.mirror), limbs(NAMES, body)
    points = body.points_in_world(q, known.points, known.ends)
    for v, camera in enumerate(scene.rig.cameras):
        pixels, reach_px = camera.project(points), 0.075 * camera.matrix[0, 0] / camera.in_camera(points)[:, 2]
        best = None
        for detection in views[v]:
            for swapped in itertools.product((False, True), repeat=len(groups)):
                limb = np.concatenate([[-1], *itertools.compress(groups, swapped)])
                moved = np.flatnonzero(np.isin(known.rows, limb))
                rows = known.rows.copy()
                rows[moved] = partner[rows[moved]]
                square = (np.linalg.norm(pixels - detection[rows, :2], axis=1) / reach_px) ** 2
                losses = square / (1 + square)
                losses[moved] += 0.25
                if best is None or losses.sum() < best.sum():
                    best = losses
        np.testing.assert_allclose(matched.losses[0, v], best, atol=1e-9)


def test_a_body_turned_round_is_farther_off_than_a_view_with_its_sides_exchanged(scene: Scene, tmp_path: Path) -> None:
    """Left and right of the detector tell where it faces, though single views may have them wrong."""
    views = detected(scene, noise_px=2.0)
    swap_a_view(views)
    evidence, asked = ask(scene, views, tmp_path)
    truth = scene.persons[0].q
    turned = truth.copy()
    turned[asked.body.root.turn] += np.pi
    right, wrong = evidence.distances(asked, np.array([truth, turned]))
    assert wrong > 2 * right


def test_what_one_view_alone_has_elsewhere_is_no_doubt_about_a_limb(scene: Scene, tmp_path: Path) -> None:
    """What most views have elsewhere is: the elbow's limb there is unexplained, and that limb only."""
    truth, body = scene.persons[0].q, scene.persons[0].body
    elbow = NAMES.index("left_elbow")
    arm, others = body.parts_of("left_arm"), ~body.parts_of("left_arm")
    for n_wrong, doubted in ((1, False), (4, True)):
        views = detected(scene)
        for view in views[:n_wrong]:
            view[0, elbow, :2] += 90
        evidence, asked = ask(scene, views, tmp_path / str(n_wrong))
        left_over = evidence.account(asked, truth).left_over_px
        assert (left_over[arm].sum() > 0) == doubted
        assert left_over[others].sum() == 0


def test_a_detection_of_somebody_else_is_no_doubt_about_a_person(scene: Scene, tmp_path: Path) -> None:
    views = detected(scene)
    views[0][0, :, :2] = 2 * np.nanmean(views[0][0, :, :2], axis=0) - [40, 0] - views[0][0, :, :2]
    views[0][0, :, 0] += 150
    evidence, asked = ask(scene, views, tmp_path)
    account = evidence.account(asked, scene.persons[0].q)
    assert account.explained == 1.0
    three = ask(scene, [view[:0] if v == 0 else view for v, view in enumerate(views)], tmp_path / "three")
    np.testing.assert_array_equal(account.visible_px, three[0].account(three[1], scene.persons[0].q).visible_px)


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


def test_files_that_cannot_be_used_are_refused_before_the_first_frame(scene: Scene, tmp_path: Path) -> None:
    pattern = written(detected(scene), scene.rig.names, tmp_path)
    beside = TogetherEvidence(of=(AutoEvidence(), KeypointEvidence(path=pattern)), refining=(1.0, 1.0))
    beside.check(scene)
    assert beside.told((None,) * 4).endswith(f"; keypoints in {pattern}")
    absent = TogetherEvidence(of=(AutoEvidence(), KeypointEvidence(path=str(tmp_path / "absent" / "{view}"))))
    with pytest.raises(ConfigError, match="does not exist; expected a folder of OpenPose's JSON files"):
        absent.check(scene)
    other = KeypointEvidence(path=pattern, names=tuple(f"point{k}" for k in range(17)))
    with pytest.raises(ConfigError, match='no keypoint means a point of model "gavrila22"; keypoints: point0, '):
        other.check(scene)


def test_a_point_that_a_view_cannot_show_has_no_place_in_it(scene: Scene, tmp_path: Path) -> None:
    """Behind a camera: as bad as an outlier, wherever the keypoint is, and nothing pulls it."""
    views = detected(scene)
    views[0][..., :2] = 300.0, 200.0
    evidence, asked = ask(scene, views, tmp_path)
    q = scene.persons[0].q.copy()
    q[:3] += 2 * (scene.rig.cameras[0].centre - q[:3])
    matched = evidence._matched(asked, q[None])
    np.testing.assert_array_equal(matched.losses[0, 0], 1.0)
    np.testing.assert_array_equal(matched.weights[0, 0], 0.0)
    assert (matched.weights[0, 2] > 0).any()


def test_evidence_of_another_layout_than_its_number_says_is_refused(scene: Scene, tmp_path: Path) -> None:
    """Limbs of wrong keypoints have other lengths; nothing else would tell, and the poses would be off."""
    for name, layout in (("wrong", "body_25b"), ("right", "body_25")):
        views = []
        for coco in detected(scene, noise_px=2.0):
            found = np.zeros((1, 25, 3))
            for k, keypoint in enumerate(LAYOUTS[layout]):
                if keypoint in NAMES:
                    found[:, k] = coco[:, NAMES.index(keypoint)]
            views.append(found)
        pattern = written(views, scene.rig.names, tmp_path / name)
        if layout == "body_25b":
            told = 'read as body_25, told by their number, .* as body_25b: set layout = "body_25b"'
            with pytest.raises(ConfigError, match=told):
                KeypointEvidence(path=pattern).check(scene)
        else:
            KeypointEvidence(path=pattern).check(scene)
        KeypointEvidence(path=pattern, layout=layout).check(scene)
