"""Starts of upper bodies: a person at a desk, whose legs no view shows, on no floor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.bodies.scene import Person, Scene
from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.evidence.auto import AutoEvidence
from tracker.foundation.errors import InitializationError
from tracker.foundation.resources import model_path
from tracker.images.plate import Plate
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.estimation.best_first import BestFirstEstimation
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.initialization import Stages
from tracker.tracking.initialization import _upper_bodies as upper_bodies
from tracker.tracking.initialization._upper_bodies import has_upper_body_alone, hull_tops, upper_poses
from tracker.tracking.initialization._visual_hull import visual_hull
from tracker.tracking.initialization.auto import AutoInitialization
from tracker.tracking.initialization.pca import PcaInitialization

PLACES = {"a": (1.2, -0.9, 0.5), "b": (1.4, 0.2, 0.7), "c": (0.9, 1.2, 0.4), "d": (-0.3, 1.5, 0.6)}
CHEST = np.array([0.1, 0.05, 0.15])
RIG = Rig(tuple(Camera.looking_at(name, (320, 240), 300.0, place, CHEST) for name, place in PLACES.items()))
"""Webcams around a desk whose top is the world's floor: they show a person from the head to the belly."""

WALL, CLOTHES = 190, (60, 90, 160)


@pytest.fixture(scope="module")
def upper() -> BodyModel:
    return load_body(model_path("upper21"))


@pytest.fixture(scope="module")
def scene(upper: BodyModel) -> Scene:
    """A man whose pelvis is lower than the desk, the hands before the chest."""
    q = upper.rest()
    q[upper.root.shifts] = 0.1, 0.05, -0.25
    for name, angle_deg in {"arm_elevation": 35.0, "arm_extension": 80.0, "arm_abduction": 15.0}.items():
        q[upper.columns(name)] = np.radians(angle_deg)
    q[upper.index("torso_twist")] = np.radians(20.0)
    return Scene((Person("man", upper, q),), RIG)


def drawn(scene: Scene) -> Frame:
    masks = CpuSynthesis().silhouettes(scene)
    return Frame(0, 0.0, tuple(np.where(mask[..., None], CLOTHES, WALL).astype(np.uint8) for mask in masks))


def walls() -> tuple[Plate, ...]:
    return tuple(Plate(np.full((one.size[1], one.size[0], 3), WALL, np.uint8)) for one in RIG.cameras)


@pytest.mark.parametrize(
    ("model", "upper_alone"), [("upper21", True), ("upper32", False), ("human", False), ("quadruped", False)]
)
def test_bodies_whose_legs_do_not_move_are_upper_bodies(model: str, upper_alone: bool) -> None:
    assert has_upper_body_alone(load_body(model_path(model))) is upper_alone


def test_the_views_show_no_legs(scene: Scene) -> None:
    """Or the tests below would show nothing."""
    person = scene.persons[0]
    marks = dict(zip(person.body.landmark_names, person.body.landmarks_in_world(person.q), strict=True))
    for camera in RIG.cameras:
        (_, knee_row), (_, head_row) = camera.project(np.array([marks["left_knee"], marks["head_top"]]))
        assert head_row > 0
        assert knee_row > camera.size[1]


def test_a_head_is_a_top_of_what_stands_out(scene: Scene) -> None:
    person = scene.persons[0]
    (head,) = person.body.landmarks_in_world(person.q)[[person.body.landmark_names.index("head_top")]]
    tops = hull_tops(visual_hull(RIG, CpuSynthesis().silhouettes(scene), 0), len(RIG))
    assert np.linalg.norm(tops - head, axis=1).min() < 0.12
    assert (np.diff(tops[:, 2]) <= 0).all(), "the highest first"


def test_only_trunks_in_the_foreground_are_tried(scene: Scene, upper: BodyModel) -> None:
    poses = upper_poses(upper, RIG, CpuSynthesis().silhouettes(scene))
    gaps = np.linalg.norm(upper.landmarks_in_world(poses) - upper.landmarks_in_world(scene.persons[0].q), axis=2)
    shoulders = [upper.landmark_names.index(f"{side}_shoulder") for side in ("left", "right")]
    assert gaps[:, shoulders].max(axis=1).min() < 0.12
    assert len(upper_poses(upper, RIG, CpuSynthesis().silhouettes(scene), (0.1, 0.1))) == len(poses)
    assert not len(upper_poses(upper, RIG, CpuSynthesis().silhouettes(scene), (3.0, 0.1))), "he is not there"
    nothing = tuple(np.zeros((240, 320), np.bool_) for _ in RIG.cameras)
    assert not len(upper_poses(upper, RIG, nothing))


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> AutoInitialization:
    monkeypatch.setattr(upper_bodies, "_TURN_DEG", 60.0)
    fine = BestFirstEstimation(range_deg=60.0, step_deg=20.0, range_m=0.1, step_m=0.05, halvings=1, patience=2)
    return AutoInitialization(pca=PcaInitialization(hypotheses=1, finalists=2, fine=fine))


@pytest.mark.parametrize("known", [True, False])
def test_a_man_at_his_desk_is_found(scene: Scene, upper: BodyModel, quick: AutoInitialization, known: bool) -> None:
    """With plates, and before what the views show most of the time."""
    plates = walls()
    stages = Stages(CpuSynthesis(), AutoEvidence(), TwistIcpEstimation(), plates if known else (None,) * 4)
    start = quick.start(drawn(scene), scene.with_pose(0, upper.rest()), replace(stages, backdrops=lambda: plates))
    gaps = upper.landmarks_in_world(start.poses[0]) - upper.landmarks_in_world(scene.persons[0].q)
    errors = dict(zip(upper.landmark_names, np.linalg.norm(gaps, axis=1), strict=True))
    assert max(errors[name] for name in ("head_top", "neck", "left_shoulder", "right_shoulder")) < 0.06


def test_an_upper_body_needs_no_floor(scene: Scene) -> None:
    told = AutoInitialization().check(scene, (None,) * 4)
    assert told == "an upper body, at the tops of moving regions; no background plates"


def test_where_nothing_stands_out_no_upper_body_is_found(scene: Scene) -> None:
    stages = Stages(CpuSynthesis(), AutoEvidence(), TwistIcpEstimation(), walls())
    empty = Frame(0, 0.0, tuple(np.full((240, 320, 3), WALL, np.uint8) for _ in RIG.cameras))
    with pytest.raises(InitializationError, match="no top of the foreground is a head"):
        PcaInitialization().start(empty, scene, stages)
