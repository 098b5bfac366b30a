"""Starts of persons whose feet no view shows, and of limbs that the images do not show where they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from observations import four_views

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Person, Scene
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.evidence.contours import ContourEvidence
from tracker.foundation.arrays import Array
from tracker.foundation.errors import ConfigError
from tracker.images.plate import Plate
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.estimation.hybrid import HybridEstimation
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.initialization import Stages
from tracker.tracking.initialization._edge_ranking import Clues, refined_on_edges
from tracker.tracking.initialization._limbs_anew import _elsewhere, limbs_anew
from tracker.tracking.initialization._stance_search import direction_images, on_floor, posed, turned
from tracker.tracking.initialization.stance import StanceInitialization

RIG = four_views()
WALL, CLOTHES = 190, (60, 90, 160)


def cut(rig: Rig, scene: Scene, landmark: str) -> Rig:
    """The rig with images that end above a landmark of the scene's person."""
    person = scene.persons[0]
    mark = person.body.landmarks_in_world(person.q)[person.body.landmark_names.index(landmark)]
    heights = [int(camera.project(mark[None])[0, 1]) - 4 for camera in rig.cameras]
    return Rig(
        tuple(replace(one, size=(one.size[0], height)) for one, height in zip(rig.cameras, heights, strict=True))
    )


def standing(body: BodyModel, arms_deg: float) -> Scene:
    q = posed(body, {"arm_abduction": arms_deg, "leg_abduction": 5.0})
    (q,) = on_floor(body, turned(body, q, np.array([0.5])), np.array([[0.23, -0.31]]), 0.0)
    return Scene((Person("one", body, q),), RIG)


def drawn(scene: Scene) -> Frame:
    """A person of one colour before walls of another."""
    masks = CpuSynthesis().silhouettes(scene)
    return Frame(0, 0.0, tuple(np.where(mask[..., None], CLOTHES, WALL).astype(np.uint8) for mask in masks))


def stages_of(scene: Scene) -> Stages:
    walls = tuple(Plate(np.full((one.size[1], one.size[0], 3), WALL, np.uint8)) for one in scene.rig.cameras)
    return Stages(CpuSynthesis(), ContourEvidence(), HybridEstimation(), (None,) * 4, lambda: walls)


def errors_m(body: BodyModel, q: Array, true: Array) -> dict[str, float]:
    gaps = np.linalg.norm(body.landmarks_in_world(q) - body.landmarks_in_world(true), axis=1)
    return dict(zip(body.landmark_names, gaps, strict=True))


def test_who_is_cut_off_by_all_images_is_found_where_something_moves(body: BodyModel) -> None:
    whole = standing(body, 45.0)
    scene = Scene(whole.persons, cut(RIG, whole, "left_knee"))
    near = {"farthest_m": 6.0}  # the cameras are 5 m away
    initialization = StanceInitialization(stances_deg=body.start.stances_deg[:3], hypotheses=2, **near)
    start = initialization.start(drawn(scene), scene, stages_of(scene))
    best = min((errors_m(body, one.q, whole.persons[0].q) for one in start.hypotheses[0]), key=lambda e: e["pelvis"])
    assert max(best[name] for name in best if "knee" not in name and "ankle" not in name and "toe" not in name) < 0.1


def test_who_is_cut_off_by_all_images_is_not_refused_and_who_is_not_in_them_is(body: BodyModel) -> None:
    whole = standing(body, 45.0)
    cut_off = Scene(whole.persons, cut(RIG, whole, "left_knee"))
    assert "cut off by the images" in StanceInitialization(farthest_m=5.0).check(cut_off, (None,) * 4)
    with pytest.raises(ConfigError, match="no place on the floor where two views show a whole person"):
        StanceInitialization(farthest_m=0.5).check(cut_off, (None,) * 4)


def test_an_arm_in_the_wrong_place_is_found_by_looking_for_it_alone(body: BodyModel) -> None:
    scene = standing(body, 10.0)
    frame, true = drawn(scene), scene.persons[0].q
    stages = replace(stages_of(scene), estimation=TwistIcpEstimation())  # which looks near the pose only
    wrong = true.copy()
    wrong[body.columns("left_arm_elevation")] = -0.9
    wrong[body.columns("left_arm_abduction")] = 1.7
    wrong = body.clamped(wrong)
    clues = Clues(direction_images(frame, 0.035))
    one = refined_on_edges(frame, scene, stages, wrong)
    assert errors_m(body, one.q, true)["left_wrist"] > 0.3
    assert one.limbs_left_over["left_arm"] > 3 * one.limbs_left_over["right_arm"]
    found = clues.ranked(scene, [one, *limbs_anew(frame, scene, stages, clues, one)])[0]
    assert errors_m(body, found.q, true)["left_wrist"] < 0.05


def test_limbs_in_their_place_are_left_alone(body: BodyModel) -> None:
    scene = standing(body, 45.0)
    frame, stages = drawn(scene), stages_of(scene)
    clues = Clues(direction_images(frame, 0.035))
    right = refined_on_edges(frame, scene, stages, scene.persons[0].q)
    assert limbs_anew(frame, scene, stages, clues, right) == []


def test_a_limb_without_limits_is_looked_for_all_round(body: BodyModel) -> None:
    free = tuple(replace(one, limits=(-np.inf, np.inf)) if "arm" in one.name else one for one in body.parameters)
    q, columns = body.rest(), body.group("left_arm")
    poses = _elsewhere(replace(body, parameters=free), "left_arm", q)
    assert np.ptp(poses[:, columns], axis=0).min() > 1.9 * np.pi
    assert np.abs(poses[:, columns] - q[columns]).max() <= np.pi
    np.testing.assert_array_equal(np.delete(poses, columns, axis=1), np.tile(np.delete(q, columns), (len(poses), 1)))
