"""Start poses from keypoints: faults of detectors, inverse kinematics, and what is said where it cannot be done."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from detected import NAMES, detected, exchanged, written
from observations import bent, four_views
from recordings import cycle_for, small_simulation
from rounding import SINGLE, assert_alike

from tracker.bodies.body import BodyModel
from tracker.bodies.keypoint_layouts.orders import LAYOUTS
from tracker.bodies.keypoints import limbs, meant, skeletons, swapped_sides
from tracker.bodies.scene import Person, Scene
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.evidence.auto import AutoEvidence
from tracker.evidence.keypoints import KeypointEvidence
from tracker.evidence.together import TogetherEvidence
from tracker.foundation.arrays import Array
from tracker.foundation.errors import ConfigError, InitializationError
from tracker.tracking.initialization import Stages
from tracker.tracking.initialization._inverse_kinematics import fitted_pose
from tracker.tracking.initialization.keypoints import KeypointInitialization
from tracker.tracking.start import Hypothesis, Start

MARKED = [k for k, name in enumerate(NAMES) if k > 4]
"""Keypoints that the 22-parameter body has as landmarks: all but those of the face."""


@pytest.fixture(scope="module")
def scene(body: BodyModel) -> Scene:
    return Scene((Person("one", body, bent(body)),), four_views((720, 576)))


@pytest.fixture(scope="module")
def stages() -> Stages:
    return cycle_for(small_simulation(n_frames=1)).stages


def true_points(scene: Scene, person: int = 0) -> Array:
    """(17, 3) where the keypoints are."""
    one = scene.persons[person]
    marks = one.body.landmarks_in_world(one.q)
    names = one.body.landmark_names
    return np.array([marks[names.index(name)] if name in names else [np.nan] * 3 for name in NAMES])


def found_in(scene: Scene, views: list[Array], most: int = 1) -> list[Array]:
    """Points of the persons that views agree on."""
    body = scene.persons[0].body
    found = skeletons(scene.rig, views, swapped_sides(NAMES, body.mirror), limbs(NAMES, body), most)
    return [one.points for one in found]


def swap_one(views: list[Array]) -> None:
    views[1] = exchanged(views[1], ("left", "right"))


def swap_legs(views: list[Array]) -> None:
    views[2] = exchanged(views[2], ("hip", "knee", "ankle"))


def swap_arms_and_legs(views: list[Array]) -> None:
    views[0] = exchanged(views[0], ("shoulder", "elbow", "wrist"))
    views[3] = exchanged(views[3], ("hip", "knee", "ankle"))


def add_false_person(views: list[Array]) -> None:
    coat = np.random.default_rng(3).uniform(50, 500, (1, 17, 3))
    coat[..., 2] = 0.9
    views[0] = np.concatenate([coat, views[0]])
    views[2] = np.concatenate([views[2], coat + 20])


def miss_a_view(views: list[Array]) -> None:
    views[1] = views[1][:0]


def misplace_a_wrist(views: list[Array]) -> None:
    views[1][0, NAMES.index("left_wrist"), :2] += 150


FAULTS = (swap_one, swap_legs, swap_arms_and_legs, add_false_person, miss_a_view, misplace_a_wrist)


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
def test_faults_of_a_detector_do_not_reach_space(fault: Callable[[list[Array]], None], scene: Scene) -> None:
    views = detected(scene, noise_px=2.0)
    fault(views)
    (points,) = found_in(scene, views)
    # 2 px are 12 mm at the person; two views that are left may see a point at a sharp angle
    assert np.linalg.norm(points - true_points(scene), axis=1)[MARKED].max() < 0.06


def test_where_nobody_is_nobody_is_found(scene: Scene) -> None:
    noise = [np.random.default_rng(k).uniform(0, 500, (2, 17, 3)) for k in range(4)]
    assert found_in(scene, noise, most=2) == []
    assert found_in(scene, [np.zeros((0, 17, 3))] * 4) == []


def test_two_persons_are_told_apart(scene: Scene, body: BodyModel) -> None:
    q = scene.persons[0].q.copy()
    q[:2] += 0.9, -0.5
    both = Scene((*scene.persons, Person("two", body, q)), scene.rig)
    views = detected(both, noise_px=2.0)
    views[1] = views[1][::-1]
    found = found_in(both, views, most=3)
    assert len(found) == 2
    for k in range(2):
        gaps = [np.nanmean(np.linalg.norm(points - true_points(both, k), axis=1)) for points in found]
        assert min(gaps) < 0.03 < max(gaps)


@pytest.mark.parametrize("seed", range(4))
def test_inverse_kinematics_finds_the_pose(body: BodyModel, seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = body.clamped(bent(body) + np.where(body.rotates, 0.3, 0.2) * rng.normal(size=body.dof))
    q[body.root.turn] = rng.uniform(-np.pi, np.pi)
    marks = meant(body.landmark_names, body)
    points = body.landmarks_in_world(q)
    pose, left = fitted_pose(body, marks, points, np.ones(len(marks.rows)))
    np.testing.assert_array_equal(pose, body.clamped(pose))
    # the weak pull towards the reference pose is left
    assert left.max() < 0.01
    points[3] += 0.5
    robust, _ = fitted_pose(body, marks, points, np.ones(len(marks.rows)))
    gaps = np.linalg.norm(body.landmarks_in_world(robust) - body.landmarks_in_world(q), axis=1)
    assert np.median(gaps) < 0.03


def test_a_start_is_found_in_files(scene: Scene, stages: Stages, tmp_path: Path) -> None:
    views = detected(scene, noise_px=2.0)
    for fault in (swap_one, add_false_person):
        fault(views)
    pattern = written(views, scene.rig.names, tmp_path, frame=7)
    body = scene.persons[0].body
    lost = scene.with_pose(0, body.rest())
    start = KeypointInitialization(path=pattern).start(Frame(7, 0.0, (None,) * 4), lost, stages)
    gaps = np.linalg.norm(body.landmarks_in_world(start.poses[0]) - body.landmarks_in_world(scene.persons[0].q), axis=1)
    assert gaps.mean() < 0.025


@pytest.mark.parametrize("beside", [False, True], ids=["images alone", "keypoints as evidence too"])
def test_sides_exchanged_in_all_views_are_told(beside: bool, tmp_path: Path) -> None:
    """All views agree then, and the keypoints alone cannot tell; the images do."""
    simulation = small_simulation(n_frames=1)
    scene = simulation.scene.with_poses(tuple(poses[0] for poses in simulation.poses))
    stages, (frame,) = cycle_for(simulation).stages, tuple(simulation.frames())
    views, told = detected(scene, noise_px=1.0), []
    for name, found in (("right", views), ("wrong", [exchanged(view, ("left", "right")) for view in views])):
        pattern = written(found, scene.rig.names, tmp_path / name, frame.index)
        if beside:
            both = TogetherEvidence(of=(AutoEvidence(), KeypointEvidence(path=pattern)), refining=(1.0, 1.0))
            stages = replace(stages, evidence=both)
        told.append(KeypointInitialization(path=pattern).start(frame, scene, stages))
    assert not told[0].turned_round
    assert set(told[1].turned_round) == {0}
    assert [one.least_sureness for one in told] == [1.0, 1.0], "searches elsewhere do not know better than keypoints"
    ((sure,), (wrong,)) = (one.told_sureness for one in told)
    assert sure == next(one.explained for one in told[0].hypotheses[0] if one.given) > 0.8
    assert wrong == 0.0


def test_how_sure_others_poses_are_is_told_by_what_they_explain(scene: Scene) -> None:
    q = scene.persons[0].q
    mine, other = Hypothesis(q, 3.0, 0.9, 0.1, 0.0, given=True), Hypothesis(q, 3.0, 0.95, 0.05, 180.0)
    assert Start((q,), hypotheses=((mine,),)).told_sureness == (0.9,)
    assert Start((q,), hypotheses=((other, mine),)).told_sureness == (0.0,)
    assert Start((q,), hypotheses=((mine,),), sureness=(0.4,)).told_sureness == (0.4,)
    assert Start((q,)).told_sureness == Start((q,), hypotheses=((other,),)).told_sureness == ()


def test_keypoints_of_larger_images_are_scaled_or_refused(scene: Scene, stages: Stages, tmp_path: Path) -> None:
    views = detected(scene)
    for view in views:
        view[..., :2] = (view[..., :2] + 0.5) * 2 - 0.5
    pattern, frame = written(views, scene.rig.names, tmp_path), Frame(0, 0.0, (None,) * 4)
    body = scene.persons[0].body
    pose = KeypointInitialization(path=pattern, downscale=2).start(frame, scene, stages).poses[0]
    gaps = np.linalg.norm(body.landmarks_in_world(pose) - body.landmarks_in_world(scene.persons[0].q), axis=1)
    assert gaps.mean() < 0.015
    averaged = Rig(tuple(replace(camera, downscale=2) for camera in scene.rig.cameras))
    same = KeypointInitialization(path=pattern).start(frame, Scene(scene.persons, averaged), stages).poses[0]
    assert_alike(pose, same, SINGLE)
    with pytest.raises(InitializationError, match="set downscale"):
        KeypointInitialization(path=pattern).start(frame, scene, stages)


def test_a_frame_without_the_person_says_what_was_detected(scene: Scene, stages: Stages, tmp_path: Path) -> None:
    views = detected(scene)
    pattern = written([views[0], *(view[:0] for view in views[1:])], scene.rig.names, tmp_path)
    with pytest.raises(InitializationError, match=r"the views agree on 0 \(detected: 1 in a, 0 in b") as caught:
        KeypointInitialization(path=pattern).start(Frame(0, 0.0, (None,) * 4), scene, stages)
    assert "\n" not in str(caught.value)


def test_held_persons_keep_their_poses(scene: Scene, stages: Stages, body: BodyModel, tmp_path: Path) -> None:
    both = Scene((*scene.persons, Person("two", body, body.rest())), scene.rig)
    pattern = written(detected(scene), scene.rig.names, tmp_path)
    start = KeypointInitialization(path=pattern).start(Frame(0, 0.0, (None,) * 4), both, replace(stages, held=(1,)))
    np.testing.assert_array_equal(start.poses[1], body.rest())


def two_persons(scene: Scene, body: BodyModel, apart_m: float) -> Scene:
    q = scene.persons[0].q.copy()
    q[:2] += apart_m, -0.5
    return Scene((*scene.persons, Person("two", body, q)), scene.rig)


def test_who_is_looked_for_is_not_who_is_held(scene: Scene, stages: Stages, body: BodyModel, tmp_path: Path) -> None:
    """The held person's keypoints fit as well, and better where the other one's are noisy."""
    both = two_persons(scene, body, 0.9)
    views = [
        np.concatenate([rough[:1], exact[1:]])
        for exact, rough in zip(detected(both), detected(both, noise_px=2.0), strict=True)
    ]
    lost, frame, held = both.with_pose(0, body.rest()), Frame(0, 0.0, (None,) * 4), replace(stages, held=(1,))
    pattern = written(views, scene.rig.names, tmp_path / "both")
    start = KeypointInitialization(path=pattern).start(frame, lost, held)
    gap = body.landmarks_in_world(start.poses[0]) - body.landmarks_in_world(scene.persons[0].q)
    assert np.linalg.norm(gap, axis=1).mean() < 0.03
    pattern = written([view[1:] for view in views], scene.rig.names, tmp_path / "held alone")
    with pytest.raises(InitializationError, match="agree on 0 beside those with known poses"):
        KeypointInitialization(path=pattern).start(frame, lost, held)


def test_where_persons_are_told_to_be_counts(scene: Scene, stages: Stages, body: BodyModel, tmp_path: Path) -> None:
    both = two_persons(scene, body, 0.9)
    places = [body.landmarks_in_world(person.q)[:, :2].mean(axis=0) for person in both.persons]
    pattern, frame = written(detected(both), scene.rig.names, tmp_path), Frame(0, 0.0, (None,) * 4)
    for told, other in ((0, 1), (1, 0)):
        persons = tuple(
            replace(person, at=tuple(places[n])) for person, n in zip(both.persons, (told, other), strict=True)
        )
        start = KeypointInitialization(path=pattern).start(frame, Scene(persons, scene.rig), stages)
        found = [body.landmarks_in_world(q)[:, :2].mean(axis=0) for q in start.poses]
        np.testing.assert_allclose(found, [places[told], places[other]], atol=0.05)


def test_what_cannot_work_is_refused_before_the_first_frame(scene: Scene, tmp_path: Path) -> None:
    pattern = written(detected(scene), scene.rig.names, tmp_path)
    told = KeypointInitialization(path=pattern).check(scene, (None,) * 4)
    assert told == f"keypoints, 17 a person (coco_17, told by their number, as many as h36m_17), in {pattern}"
    with pytest.raises(ConfigError, match="expected a folder of OpenPose's JSON files"):
        KeypointInitialization(path=str(tmp_path / "absent" / "{view}")).check(scene, (None,) * 4)
    other = tuple(f"point{k}" for k in range(17))
    with pytest.raises(ConfigError, match='0 of the keypoints mean points of model "gavrila22"'):
        KeypointInitialization(path=pattern, names=other).check(scene, (None,) * 4)


def test_a_start_that_fails_says_as_which_layout_it_fits(scene: Scene, stages: Stages, tmp_path: Path) -> None:
    """25 keypoints are BODY_25 or BODY_25B, and were all lost as the other one."""
    names = LAYOUTS["body_25b"]
    views = []
    for coco in detected(scene, noise_px=2.0):
        found = np.zeros((1, len(names), 3))
        found[:, :17] = coco
        views.append(found)
    pattern, frame = written(views, scene.rig.names, tmp_path), Frame(0, 0.0, (None,) * 4)
    for layout, read in ((None, "body_25, told by their number"), ("body_25", "body_25")):
        initialization = KeypointInitialization(path=pattern, layout=layout)
        assert f"25 a person ({read}" in initialization.check(scene, (None,) * 4)
        told = f'they were read as {read}, and fit the body as body_25b: set layout = "body_25b"'
        with pytest.raises(InitializationError, match=re.escape(told)):
            initialization.start(frame, scene, stages)
    body = scene.persons[0].body
    start = KeypointInitialization(path=pattern, layout="body_25b").start(frame, scene, stages)
    gaps = np.linalg.norm(body.landmarks_in_world(start.poses[0]) - body.landmarks_in_world(scene.persons[0].q), axis=1)
    assert gaps.mean() < 0.025


def test_a_start_in_a_frame_without_files_names_the_numbers_there_are(
    scene: Scene, stages: Stages, tmp_path: Path
) -> None:
    pattern = written(detected(scene), scene.rig.names, tmp_path, frame=1000)
    with pytest.raises(InitializationError, match=r"\(a has 1000 to 1000, this frame is 0, b has"):
        KeypointInitialization(path=pattern).start(Frame(0, 0.0, (None,) * 4), scene, stages)


def test_shares_of_the_image_are_refused_or_multiplied(scene: Scene, stages: Stages, tmp_path: Path) -> None:
    views = detected(scene)
    for view, camera in zip(views, scene.rig.cameras, strict=True):
        view[..., :2] /= camera.size
    pattern, frame = written(views, scene.rig.names, tmp_path), Frame(0, 0.0, (None,) * 4)
    for use in (KeypointInitialization(path=pattern), KeypointEvidence(path=pattern)):
        with pytest.raises(ConfigError, match="set normalized = true"):
            use.check(scene, (None,) * 4) if isinstance(use, KeypointInitialization) else use.check(scene)
    told = KeypointInitialization(path=pattern, normalized=True)
    told.check(scene, (None,) * 4)
    body = scene.persons[0].body
    pose = told.start(frame, scene, stages).poses[0]
    gaps = np.linalg.norm(body.landmarks_in_world(pose) - body.landmarks_in_world(scene.persons[0].q), axis=1)
    assert gaps.mean() < 0.015
    with pytest.raises(ConfigError, match="leave downscale out"):
        KeypointInitialization(path=pattern, normalized=True, downscale=2).check(scene, (None,) * 4)
