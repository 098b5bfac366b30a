"""`bodytrack view WHAT --place N`: bodies posed by hand over the images, figure 9 (d) of Gavrila & Davis."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser import PROGRAM, browser
from motions import made_up
from staged import Server
from typer.testing import CliRunner

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.errors import ConfigError, TrackerError
from tracker.running.cli import app
from tracker.running.jobs import execute, load_job
from tracker.running.viewing.hand_poses import Placing, begun_in_result, begun_in_run, dragged, handles, standing
from tracker.running.viewing.stage import serving
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Recipe, write_sequence
from tracker.tracking.initialization.given import GivenInitialization


@pytest.fixture
def scene() -> Scene:
    """Two persons, as found in a frame."""
    movement = made_up("human", "gavrila22")
    return movement.scene.with_poses(tuple(one.q for one in movement.steps[0].estimates))


def placing_of(scene: Scene, folder: Path) -> tuple[Placing, Server]:
    server = Server()
    images = tuple(np.full((*camera.size[::-1], 3), 90, np.uint8) for camera in scene.rig.cameras)
    placing = Placing(server, scene, Frame(7, 0.28, (None, *images[1:])), folder / "start.csv")
    placing.draw()
    return placing, server


def test_a_typed_angle_moves_that_joint_alone_and_contours_follow(scene: Scene, tmp_path: Path) -> None:
    placing, server = placing_of(scene, tmp_path)
    body, before = scene.persons[0].body, scene.persons[0].q
    column = body.index("left_arm_extension")
    drawn = server.nodes["add_image"].image.copy()
    # two models have an elbow: the sliders of the first person come first
    slider = placing._sliders[0][column]
    assert slider.node.value == pytest.approx(np.degrees(before[column]), abs=0.26)
    slider.node.value = 80.0
    placing.draw()
    q = placing.scene.persons[0].q
    assert np.degrees(q[column]) == pytest.approx(80.0)
    np.testing.assert_array_equal(np.delete(q, column), np.delete(before, column))
    np.testing.assert_array_equal(placing.scene.persons[1].q, scene.persons[1].q)
    assert (server.nodes["add_image"].image != drawn).any()
    # the body in space, and the joint to be dragged, are where the pose has them
    mark = body.landmark_names.index("left_wrist")
    np.testing.assert_allclose(placing._handles[0][mark].node.position, body.landmarks_in_world(q)[mark])


def test_the_contours_drawn_are_those_of_the_pose(scene: Scene, tmp_path: Path) -> None:
    """White where the other person is, yellow where the one is that is placed; a view without an image has none."""
    placing, _ = placing_of(scene, tmp_path)
    drawn, _ = placing._drawn(0)
    assert drawn[0] is None
    view = CpuSynthesis().contours(scene).of(1)
    own = view.parts < len(scene.persons[0].body.parts)
    for chosen, shade in ((own, (0, 215, 255)), (~own, (200, 200, 200))):
        inside = chosen & ~view.between & (view.pixels > 1).all(axis=1)
        inside &= (view.pixels < np.array(scene.rig.cameras[1].size) - 2).all(axis=1)
        x, y = np.rint(view.pixels[inside]).astype(int).T
        near = np.abs(drawn[1][y, x].astype(int) - shade).max(axis=1) < 110
        assert len(near) > 20
        assert near.mean() > 0.8


def test_a_dragged_joint_draws_its_limb_and_no_more(scene: Scene, tmp_path: Path) -> None:
    placing, _ = placing_of(scene, tmp_path)
    body, before = scene.persons[0].body, scene.persons[0].q
    mark, arm = body.landmark_names.index("right_wrist"), body.group("right_arm")
    node = placing._handles[0][mark].node
    target = body.landmarks_in_world(before)[mark] + np.array([0.03, -0.04, 0.05])
    node.position = target
    placing.draw()
    q = placing.scene.persons[0].q
    assert np.linalg.norm(body.landmarks_in_world(q)[mark] - target) < 0.005
    np.testing.assert_array_equal(np.delete(q, arm), np.delete(before, arm))
    np.testing.assert_array_equal(q, body.clamped(q))
    assert placing._sliders[0][int(arm[0])].node.value == pytest.approx(np.degrees(q[arm[0]]), abs=0.26)
    # where no arm reaches it stretches out, and the arrows come back to the wrist when they are let go
    node.position = far = target + np.array([0.0, 0.0, 3.0])
    placing.draw()
    np.testing.assert_array_equal(node.position, far)
    placing._held = mark, time.monotonic() - 1.0
    placing.draw()
    np.testing.assert_allclose(node.position, body.landmarks_in_world(placing.scene.persons[0].q)[mark])


@pytest.mark.parametrize("model", ["human", "gavrila22", "quadruped", "upper21"])
def test_the_joints_that_can_be_dragged_are_those_that_go_where_they_are_drawn(model: str) -> None:
    body = made_up(model).scene.persons[0].body
    root, *limbs = handles(body)
    q, shift = body.rest(), np.array([0.2, -0.1, 0.05])
    moved = dragged(body, q, root, body.landmarks_in_world(q)[root] + shift)
    np.testing.assert_allclose(
        body.landmarks_in_world(moved) - body.landmarks_in_world(q), np.tile(shift, (len(body.landmarks), 1)), atol=1e-9
    )
    assert len(limbs) > 3
    names = [body.landmark_names[mark] for mark in limbs]
    assert not {"left_hip", "right_hip"} & set(names), "a hip is the pelvis's"


def test_who_is_chosen_is_posed(scene: Scene, tmp_path: Path) -> None:
    placing, server = placing_of(scene, tmp_path)
    server.nodes["person"].value = "person2"
    placing.draw()
    assert not any(one.node.visible for one in placing._sliders[0].values())
    assert all(one.node.visible for one in placing._handles[1].values())
    column = scene.persons[1].body.index("torso_x")
    placing._sliders[1][column].node.value = value = placing._sliders[1][column].node.value + 0.5
    placing.draw()
    assert placing.scene.persons[1].q[column] == pytest.approx(value)
    np.testing.assert_array_equal(placing.scene.persons[0].q, scene.persons[0].q)
    placing._resetting.set()
    placing.draw()
    np.testing.assert_array_equal(placing.scene.persons[1].q, scene.persons[1].q)


def test_what_is_saved_is_the_start_that_given_reads(scene: Scene, tmp_path: Path) -> None:
    placing, server = placing_of(scene, tmp_path)
    placing._sliders[0][scene.persons[0].body.index("left_arm_extension")].node.value = 42.5
    placing.draw()
    assert not (tmp_path / "start.csv").exists()
    server.nodes["save the start"].on[0](None)
    placing.draw()
    assert placing.saved == 1
    poses = GivenInitialization(poses=tmp_path / "start.csv").poses_of(scene, 7)
    for q, person in zip(poses, placing.scene.persons, strict=True):
        np.testing.assert_allclose(q, person.q, atol=1e-5)
    assert "start.csv" in server.nodes[""].content


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three simulated frames."""
    return write_sequence(Recipe("arm_swing", seconds=0.12, size=(256, 208)), tmp_path_factory.mktemp("placed") / "seq")


@pytest.fixture(scope="module")
def result(config: Path) -> Path:
    start = ["initialization.use=given", "initialization.poses=truth_poses.csv", 'recordings=["run_json","journal"]']
    execute(load_job("track", config, [*start, "passes=1"]), config.parent / "result")
    return config.parent / "result"


def test_without_a_start_everybody_stands_before_the_cameras(config: Path, tmp_path: Path) -> None:
    found, frame = begun_in_run(config, [], 2)
    assert frame.index == 2
    marks = found.persons[0].body.landmarks_in_world(found.persons[0].q)
    assert marks[:, 2].min() == pytest.approx(0, abs=1e-9)
    for camera in found.rig.cameras:
        pixels = camera.project(marks)
        assert ((pixels > 0) & (pixels < camera.size)).all(axis=1).mean() > 0.5
    # what somebody has saved is where the next one goes on
    placed = Placing(Server(), found, frame, tmp_path / "start.csv")
    placed._saving.set()
    placed.draw()
    again, _ = begun_in_run(config, ["initialization.use=given", f"initialization.poses={tmp_path / 'start.csv'}"], 1)
    np.testing.assert_allclose(again.persons[0].q, found.persons[0].q, atol=1e-5)


def test_several_stand_side_by_side(scene: Scene) -> None:
    ours = standing(replace(scene, persons=(scene.persons[0],) * 2))
    gap = np.diff([person.body.landmarks_in_world(person.q).mean(axis=0) for person in ours.persons], axis=0)[0]
    np.testing.assert_allclose(gap, [1.0, 0.0, 0.0], atol=1e-9)


def test_a_result_begins_where_the_run_has_found_the_person(result: Path) -> None:
    found, frame = begun_in_result(result, 1)
    truth = np.genfromtxt(result.parent / "truth_poses.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert frame.index == 1
    assert found.persons[0].q[0] == pytest.approx(truth["torso_x_m"][1], abs=0.02)
    with pytest.raises(ConfigError, match="no frame 9, the nearest is 2"):
        begun_in_result(result, 9)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--place", "1", "--output", "TAKEN"], "--overwrite"),
        (["--place", "44"], "frame 44|44"),
        (["--output", "here.csv"], "--output: only --place writes a file"),
        (["--overwrite"], "--overwrite: only --place writes a file"),
    ],
)
def test_what_cannot_be_is_told_before_anything_is_served(config, tmp_path, monkeypatch, options, words):
    monkeypatch.setattr("tracker.running.viewing.stage.serving", lambda *_, **__: pytest.fail("served"))
    taken = tmp_path / "taken.csv"
    taken.write_text("mine")
    arguments = [str(taken) if one == "TAKEN" else one for one in options]
    with pytest.raises(TrackerError, match=words):
        CliRunner().invoke(app, ["view", str(config), *arguments], catch_exceptions=False)
    assert taken.read_text() == "mine"


# 0.3 into the number beside the slider of torso_x_m, as React's inputs notice it.
_TYPED = """(() => {
  const label = [...document.querySelectorAll('label')].find(one => one.textContent === 'torso_x_m');
  let row = label;
  while (!row.querySelector('input[type=text]')) row = row.parentElement;
  const field = row.querySelector('input[type=text]');
  Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value').set.call(field, '0.3');
  field.dispatchEvent(new Event('input', {bubbles: true}));
  field.dispatchEvent(new Event('focusout', {bubbles: true}));
  return true;
})()"""


@pytest.mark.skipif(PROGRAM is None, reason="no Chromium (apt-get install chromium)")
def test_a_browser_types_an_angle_and_saves(config: Path, tmp_path: Path) -> None:
    found, frame = begun_in_run(config, [], 0)
    with serving(18140, wide=True) as server, browser(tmp_path / "profile") as page:
        placing = Placing(server, found, frame, tmp_path / "start.csv")
        page.open(f"http://127.0.0.1:{server.get_port()}")

        def until(true) -> None:
            end = time.monotonic() + 60
            while not true() and time.monotonic() < end:
                placing.serve(0.1)
            assert true(), page.errors

        until(lambda: page.value(_TYPED))
        until(lambda: placing.scene.persons[0].q[0] == 0.3)
        page.value("[...document.querySelectorAll('button')].find(one => one.innerText === 'save the start').click()")
        until(lambda: placing.saved == 1)
        assert page.errors == []
    assert GivenInitialization(poses=tmp_path / "start.csv").poses_of(found, 0)[0][0] == pytest.approx(0.3)
