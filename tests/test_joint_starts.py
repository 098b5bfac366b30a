"""Starts from a table of joint centres: of this program, of another one, of a marker system."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from observations import bent, four_views

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Person, Scene
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array
from tracker.foundation.errors import ConfigError
from tracker.tracking.initialization.auto import AutoInitialization
from tracker.tracking.initialization.given import GivenInitialization

OTHERS = {"left_elbow": "l_elbow", "right_elbow": "RElbow", "left_hip": "LHip", "right_wrist": "right wrist"}


def scene_of(body: BodyModel, views: Rig, *names: str) -> Scene:
    return Scene(tuple(Person(name, body, body.rest()) for name in names), views)


def joints_of(body: BodyModel, q: Array) -> dict[str, Array]:
    return dict(zip(body.landmark_names, body.landmarks_in_world(q), strict=True))


def joint_file(path: Path, frames: dict[int, dict[str, Array]], axes: str = "x y z", person: str | None = None) -> Path:
    names = ["frame", *(["person"] if person else []), "joint", *axes.split()]
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        for index, joints in frames.items():
            for name, point in joints.items():
                writer.writerow([index, *([person] if person else []), name, *point])
    return path


def started(path: Path, scene: Scene, index: int = 0) -> Array:
    return GivenInitialization(poses=path).poses_of(scene, index)[0]


@pytest.fixture
def views() -> Rig:
    return four_views((360, 288))


@pytest.mark.parametrize("axes", ["x y z", "x_m y_m z_m"])
def test_the_body_is_brought_to_the_joints(body: BodyModel, views: Rig, tmp_path: Path, axes: str) -> None:
    """Whatever they are called; the limits of the joints and twists that no joint shows leave millimetres."""
    q = body.clamped(bent(body))
    joints = {OTHERS.get(name, name): point for name, point in joints_of(body, q).items()}
    found = started(joint_file(tmp_path / "joints.csv", {0: joints}, axes), scene_of(body, views, "anna"))
    off = np.linalg.norm(body.landmarks_in_world(found) - body.landmarks_in_world(q), axis=1)
    assert off.max() < 0.01


def test_the_frame_is_the_nearest_earlier_one(body: BodyModel, views: Rig, tmp_path: Path) -> None:
    early, late = bent(body), bent(body)
    late[body.index("torso_x")] += 1.0
    path = joint_file(tmp_path / "joints.csv", {3: joints_of(body, early), 8: joints_of(body, late)})
    x = [started(path, scene_of(body, views, "anna"), index)[body.index("torso_x")] for index in (0, 5, 9)]
    np.testing.assert_allclose(np.array(x) - early[body.index("torso_x")], [0, 0, 1], atol=0.02)


def test_poses_need_not_be_in_order(body: BodyModel, views: Rig, tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, ["frame", "person", *(parameter.column for parameter in body.parameters)])
        writer.writeheader()
        for frame in (8, 5, 3):
            zero = {parameter.column: "0" for parameter in body.parameters}
            writer.writerow({"frame": frame, "person": "anna", **zero, "torso_x_m": f"0.{frame}"})
    x = [started(path, scene_of(body, views, "anna"), index)[body.index("torso_x")] for index in (0, 3, 6, 9)]
    assert x == [0.3, 0.3, 0.5, 0.8]


def test_joints_of_all_frames_are_read_before_the_first_one(body: BodyModel, views: Rig, tmp_path: Path) -> None:
    later = joints_of(body, bent(body)) | {"neck": np.array([0.0, 0.0, np.inf])}
    path = joint_file(tmp_path / "joints.csv", {0: joints_of(body, bent(body)), 70: later})
    with pytest.raises(ConfigError, match=r'"z" is .inf., expected a finite number'):
        GivenInitialization(poses=path).check(scene_of(body, views, "anna"), (None,) * 4)


def test_a_head_that_may_be_its_middle_is_not_its_top(body: BodyModel, views: Rig, tmp_path: Path) -> None:
    q = body.clamped(bent(body))
    joints = joints_of(body, q)
    joints["head"] = joints["head_top"] - [0.0, 0.0, 0.3]
    found = started(joint_file(tmp_path / "joints.csv", {0: joints}), scene_of(body, views, "anna"))
    assert np.linalg.norm(body.landmarks_in_world(found) - body.landmarks_in_world(q), axis=1).max() < 0.01


def test_who_is_who_is_told_by_name(body: BodyModel, views: Rig, tmp_path: Path) -> None:
    joints = joints_of(body, bent(body))
    scene, path = scene_of(body, views, "anna", "ben"), joint_file(tmp_path / "j.csv", {0: joints}, person="anna")
    with pytest.raises(ConfigError, match='no start pose of person "ben"; '):
        GivenInitialization(poses=path).check(scene, (None,) * 4)
    # of one person nobody needs the name
    alone = scene_of(body, views, "ben")
    assert AutoInitialization(poses=path).check(alone, (None,) * 4) == f"given, joints in {path}"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda joints: {name: joints[name] for name in ("neck", "left_elbow")},
            "2 of the joints are landmarks of model",
        ),
        (lambda joints: {name: 1000 * point for name, point in joints.items()}, "they must be in metres"),
        (lambda joints: dict.fromkeys(joints, ("", "", "")), "no joint in it has a position"),
        (lambda joints: dict.fromkeys(joints, ("a", 0, 0)), '"x" is .a., expected a finite number'),
    ],
)
def test_joints_that_are_no_body_are_refused(
    body: BodyModel, views: Rig, tmp_path: Path, change: Callable[[dict[str, Array]], dict[str, Array]], message: str
) -> None:
    path = joint_file(tmp_path / "joints.csv", {0: change(joints_of(body, bent(body)))})
    with pytest.raises(ConfigError, match=message):
        GivenInitialization(poses=path).check(scene_of(body, views, "anna"), (None,) * 4)


def test_a_missing_axis_is_named(body: BodyModel, views: Rig, tmp_path: Path) -> None:
    path = joint_file(tmp_path / "joints.csv", {0: joints_of(body, bent(body))}, "x y height")
    with pytest.raises(ConfigError, match='no column "z" beside "joint"'):
        GivenInitialization(poses=path).check(scene_of(body, views, "anna"), (None,) * 4)
