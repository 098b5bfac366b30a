"""The floor and the axis that is up: told by resting feet, by keypoints of feet, by boards and markers on the floor."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from board_prints import chessboard
from detected import detected
from motions import MODELS, performed
from numbered_pictures import write_video
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from tracker.bodies.body.description import load_body
from tracker.bodies.feet import footfalls, heights_over_sole, sole_parts, soles
from tracker.bodies.keypoint_layouts.orders import LAYOUTS
from tracker.bodies.scene import Person, Scene
from tracker.cameras.calibration import floor_marks
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import load_rig, save_rig
from tracker.foundation.arrays import Array, Image
from tracker.foundation.errors import CalibrationError, ConfigError, TrackerError
from tracker.running.cli import app
from tracker.running.floors import fitted_floor, usual_up
from tracker.synthesis.simulation.movements import poses_of

UP = np.array([0.0, 0.0, 1.0])
pytestmark = pytest.mark.usefixtures("markers_once")

PLACES = {"near": (0.5, -3.0, 2.0), "beside": (3.2, -0.5, 2.2), "far": (0.5, 2.8, 1.8)}
ROOM = Rig(tuple(Camera.looking_at(name, (960, 540), 800.0, at, (0.3, 0.2, 0.3)) for name, at in PLACES.items()))
HUMAN = load_body(MODELS / "human.toml")


def elsewhere(turn_deg: tuple[float, float, float], shift_m: float) -> tuple[Rig, Array]:
    """The room in a world that is turned and shifted, and (4, 4) what brings the room's points there."""
    there_from_room = np.eye(4)
    there_from_room[:3, :3] = Rotation.from_euler("xyz", turn_deg, degrees=True).as_matrix()
    there_from_room[:3, 3] = (0.2, -0.1, shift_m)
    return moved(ROOM, there_from_room), there_from_room


def moved(rig: Rig, there_from_here: Array) -> Rig:
    back = np.linalg.inv(there_from_here)
    return Rig(
        tuple(
            Camera(one.name, one.size, one.matrix, one.distortion, one.camera_from_world @ back) for one in rig.cameras
        )
    )


def in_there(points: Array, there_from_here: Array) -> Array:
    return points @ there_from_here[:3, :3].T + there_from_here[:3, 3]


def scattered(n: int = 12, sigma_m: float = 0.003) -> Array:
    rng = np.random.default_rng(1)
    return np.column_stack([rng.uniform(-1, 1, (n, 2)), rng.normal(0, sigma_m, n)])


def assert_in_the_room(rig: Rig, tolerance_m: float = 0.01) -> None:
    """The cameras are as high as they are in the room."""
    heights = [camera.centre[2] for camera in rig.cameras]
    np.testing.assert_allclose(heights, [place[2] for place in PLACES.values()], atol=tolerance_m)


@pytest.mark.parametrize("turn_deg", [(0, 0, 0), (28, 0, 10), (0, -20, 0), (90, 0, 0), (0, -90, 30), (180, 0, 0)])
def test_points_of_the_floor_tell_it_and_what_is_up(turn_deg: tuple[float, float, float]) -> None:
    rig, there = elsewhere(turn_deg, -0.7)
    floor = fitted_floor(in_there(scattered(), there), rig, "points", 0.003)
    assert floor.n_directions == 2
    assert_in_the_room(floor.laid(rig))
    np.testing.assert_allclose(floor.up, there[:3, 2], atol=0.01)


def test_few_points_tell_the_height_alone() -> None:
    floor = fitted_floor(scattered(3) + 0.4 * UP, ROOM, "points", 0.003)
    assert floor.n_directions == 0
    assert floor.height_m == pytest.approx(0.4, abs=0.004)
    np.testing.assert_array_equal(floor.up, UP)
    assert any("as before: they do not tell the tilt" in line for line in floor.told())


def test_points_on_a_line_tell_the_tilt_along_it_alone() -> None:
    """What they say of the tilt across is nothing, and is not taken for something."""
    rig, there = elsewhere((10, 0, 0), 0.0)
    line = scattered() * (0.01, 1, 1)
    along = fitted_floor(in_there(line, there), rig, "points", 0.01)
    assert along.n_directions == 1
    np.testing.assert_allclose(along.up, there[:3, 2], atol=0.01)


def test_a_step_is_told_and_left_out() -> None:
    points = np.concatenate([scattered(), scattered(3) + 0.15 * UP])
    floor = fitted_floor(points, ROOM, "points", 0.003)
    assert floor.height_m == pytest.approx(0, abs=0.003)
    assert len(floor.beside_m) == 3
    assert any("3 more lie elsewhere (+1" in line for line in floor.told())


@pytest.mark.parametrize(
    ("points", "told"),
    [
        (np.zeros((0, 3)), "no points, expected at least one"),
        (scattered(sigma_m=0.2), "off one plane"),
        (scattered() + 5 * UP, "cameras would be below"),
    ],
)
def test_what_is_no_floor_is_refused(points: Array, told: str) -> None:
    with pytest.raises(CalibrationError, match=told):
        fitted_floor(points, ROOM, "points", 0.003)


def test_z_is_up_unless_the_cameras_contradict_it() -> None:
    np.testing.assert_array_equal(usual_up(ROOM), UP)
    rig, there = elsewhere((90, 0, 0), 0)
    np.testing.assert_allclose(usual_up(rig), there[:3, 2], atol=0.1)


@pytest.mark.parametrize("model", ["human", "gavrila22", "quadruped"])
def test_feet_that_walk_rest_on_the_floor(model: str) -> None:
    body = load_body(MODELS / f"{model}.toml")
    times = np.arange(0, 3, 0.04)
    poses = poses_of("bow" if model == "quadruped" else "walk", body, times, 30.0)
    points, middles = soles(body, poses, UP)
    falls = footfalls(points, middles, times, UP)
    assert len(falls) >= 2
    np.testing.assert_allclose(falls[:, 2], 0, atol=0.02)


def test_who_jumps_rests_before_and_after_it() -> None:
    times = np.arange(0, 1.6, 0.02)
    poses = np.tile(poses_of("squat", HUMAN, np.zeros(1)), (len(times), 1))
    flight = np.clip(times - 0.5, 0, 0.6)
    poses[:, HUMAN.root.shifts[2]] += 9.81 / 2 * flight * (0.6 - flight)
    points, middles = soles(HUMAN, poses, UP)
    falls = footfalls(points, middles, times, UP)
    assert len(falls) >= 2
    np.testing.assert_allclose(falls[:, 2], 0, atol=0.02)


def test_feet_in_the_air_rest_on_no_floor() -> None:
    """Of who stands on his head they are the highest part, however still they are kept."""
    points, middles = soles(HUMAN, np.tile(HUMAN.rest(), (20, 1)), -UP)
    assert np.isnan(points).all()
    assert not len(footfalls(points, middles, 0.04 * np.arange(20), -UP))


def test_bodies_without_legs_have_no_soles() -> None:
    assert not len(sole_parts(load_body(MODELS / "upper21.toml")))
    assert len(sole_parts(HUMAN)) == 2


def test_keypoints_of_feet_lie_above_the_sole() -> None:
    names = LAYOUTS["body_25"]
    heights = dict(zip(names, heights_over_sole(names, HUMAN), strict=True))
    feet = {name for name, height in heights.items() if np.isfinite(height)}
    assert len(feet) == 8, "ankles, heels, big and small toes"
    assert all(0 < heights[name] < 0.1 for name in feet)


def printed(
    rig: Rig, print_: Image, square_px: float, there: Array, place: tuple[float, float] = (0, 0)
) -> list[Image]:
    """A print on the floor as the views show it; (4, 4) where the room is, and its place in the room."""
    height, width = print_.shape
    ends = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=np.float64)
    plan = np.column_stack([0.1 * (ends * (1, -1)) / square_px + place, np.zeros(4)])
    shown = []
    for camera in rig.cameras:
        pixels = camera.project(in_there(plan, there)).astype(np.float32)
        matrix = cv2.getPerspectiveTransform(ends.astype(np.float32), pixels)
        shown.append(cv2.warpPerspective(print_, matrix, camera.size, borderValue=150, flags=cv2.INTER_AREA))
    return shown


def markers(dictionary: int, *numbers: int) -> Image:
    """Markers of 0.3 m in a row on white, half a side apart."""
    made = cv2.aruco.getPredefinedDictionary(dictionary)
    sides = [
        cv2.copyMakeBorder(made.generateImageMarker(k, 180), *(45,) * 4, cv2.BORDER_CONSTANT, value=255)
        for k in numbers
    ]
    return np.asarray(np.hstack(sides))


PRINTS = {
    "chessboard of 9 x 6 inner corners": (chessboard(9, 6), 40.0),
    "chessboard of 8 x 6 inner corners": (chessboard(8, 6), 40.0),
    "marker 7 of apriltag_36h11": (markers(cv2.aruco.DICT_APRILTAG_36h11, 7, 8, 20), 60.0),
    "marker 700 of 4x4_1000": (markers(cv2.aruco.DICT_4X4_1000, 700, 3), 60.0),
    "marker 3 of 5x5_1000": (255 - markers(cv2.aruco.DICT_5X5_50, 3, 4), 60.0),
}


@pytest.mark.parametrize("name", PRINTS)
def test_boards_and_markers_on_the_floor_tell_it_and_the_scale(name: str) -> None:
    print_, square_px = PRINTS[name]
    rig, there = elsewhere((25, 0, 40), 0.5)
    marks = floor_marks(rig, printed(rig, print_, square_px, there))
    assert name in [mark.name for mark in marks]
    expected_m = 0.1 if "chessboard" in name else 0.3
    assert [mark.side_m for mark in marks] == pytest.approx([expected_m] * len(marks), rel=0.02)
    corners = np.concatenate([mark.corners for mark in marks])
    floor = fitted_floor(corners, rig, name, 0.001)
    assert_in_the_room(floor.laid(rig), 0.02)


def test_a_marker_that_was_moved_between_the_pictures_is_no_floor() -> None:
    print_ = markers(cv2.aruco.DICT_4X4_50, 3)
    here, there = (printed(ROOM, print_, 60.0, np.eye(4), place) for place in ((0, 0), (0.3, 0.2)))
    with pytest.raises(CalibrationError, match="markers are seen in 2 of 3 views, and none in two views at a place"):
        floor_marks(ROOM, [here[0], there[1], None])


def test_pictures_without_marks_or_of_another_size_are_refused() -> None:
    blank = [np.full((540, 960), 128, np.uint8)] * 3
    with pytest.raises(CalibrationError, match="no board and no marker is seen"):
        floor_marks(ROOM, blank)
    with pytest.raises(CalibrationError, match="has 480x270 px, the rig was calibrated at 960x540"):
        floor_marks(ROOM, [blank[0][::2, ::2], *blank[1:]])


def run(*words: str | Path) -> str:
    told = CliRunner().invoke(app, ["rig", *map(str, words)])
    if told.exception is not None:
        raise told.exception
    return told.output


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    """The room's calibration, its z axis lying, and pictures of a board on its floor."""
    rig, there = elsewhere((90, 0, 0), 0.5)
    save_rig(rig, tmp_path / "rig.toml")
    for camera, picture in zip(rig.cameras, printed(rig, chessboard(9, 6), 40.0, there), strict=True):
        cv2.imwrite(str(tmp_path / f"floor_{camera.name}.png"), picture)
    return tmp_path / "rig.toml"


def test_pictures_propose_a_floor_and_set_it(rig_file: Path) -> None:
    seen = rig_file.parent / "floor_{view}.png"
    told = run("check", rig_file, "--floor", seen)
    assert "corners of chessboard of 9 x 6 inner corners" in told
    assert "90.0 degrees off z, as they lie" in told
    assert f"rig convert {rig_file} NEW.toml --floor auto --seen {seen}" in told
    run("convert", rig_file, rig_file.with_name("new.toml"), "--floor", "auto", "--seen", seen)
    assert_in_the_room(load_rig(rig_file.with_name("new.toml")))


def test_a_view_without_a_picture_of_the_floor_is_left_out(rig_file: Path) -> None:
    (rig_file.parent / "floor_far.png").unlink()
    assert "the floor is at" in run("check", rig_file, "--floor", rig_file.parent / "floor_{view}.png")


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--floor", "auto"], "needs --seen RESULT"),
        (["--floor", "0.3", "--seen", "x"], "expected --floor auto, and no --up"),
        (["--floor", "auto", "--up", "y", "--seen", "x"], "expected --floor auto, and no --up"),
        (["--floor", "low"], "expected metres along the upward axis, or auto"),
        (["--floor", "nan"], "expected metres"),
        (["--floor", "auto", "--seen", "nowhere/{view}.png"], "no such file for any of the views near, beside, far"),
        (["--floor", "auto", "--seen", "one.png"], "all 3 views would show the same"),
    ],
)
def test_options_that_do_not_fit_are_refused(options: list[str], told: str, rig_file: Path) -> None:
    with pytest.raises((ConfigError, CalibrationError), match=told):
        run("convert", rig_file, rig_file.with_name("new.toml"), *options)
    assert not rig_file.with_name("new.toml").exists()


def test_a_result_tells_the_floor_of_its_rig(tmp_path: Path) -> None:
    times = np.arange(0, 3.2, 0.04)
    poses = poses_of("walk", HUMAN, times)
    poses[:, HUMAN.root.shifts[2]] -= 0.37
    result = performed(HUMAN, poses).result(tmp_path / "result")
    told = run("check", result / "rig.toml", "--floor", result)
    assert "footfalls" in told
    height = float(told.split("the floor is at ")[1].split(" m")[0])
    assert height == pytest.approx(-0.37, abs=0.015)
    run("convert", result / "rig.toml", tmp_path / "new.toml", "--floor", "auto", "--seen", result)
    with pytest.raises(CalibrationError, match="its world is another one; expected a result of this rig"):
        run("check", tmp_path / "new.toml", "--floor", result)


def test_a_result_of_bodies_without_feet_tells_no_floor(tmp_path: Path) -> None:
    upper = load_body(MODELS / "upper21.toml")
    result = performed(upper, np.tile(upper.rest(), (12, 1))).result(tmp_path / "result")
    with pytest.raises(CalibrationError, match="no person there has feet"):
        run("check", result / "rig.toml", "--floor", result)


def detected_walk(folder: Path, names: tuple[str, ...], layout: str) -> Path:
    """A run's configuration with the keypoints of who walks in the room, whose floor is 0.5 m above its world's."""
    cameras = [Camera.looking_at(n, (960, 540), 480.0, at, (0, 0, 0.8)) for n, at in PLACES.items()]
    rig, times = moved(Rig(tuple(cameras)), lifted(0.5)), np.arange(0, 3.2, 0.04)
    poses = poses_of("walk", HUMAN, times, place=(-0.8, 0.0))
    poses[:, HUMAN.root.shifts[2]] += 0.5
    for t, q in enumerate(poses):
        for camera, found in zip(
            rig.cameras, detected(Scene((Person("anna", HUMAN, q),), rig), names=names), strict=True
        ):
            (folder / f"{camera.name}_json").mkdir(exist_ok=True)
            people = [{"pose_keypoints_2d": np.nan_to_num(person).ravel().tolist()} for person in found]
            (folder / f"{camera.name}_json" / f"{t:06d}.json").write_text(json.dumps({"people": people}))
    for camera in rig.cameras:
        write_video(folder / f"{camera.name}.mp4", [np.zeros((540, 960, 3), np.uint8)] * len(times))
    save_rig(rig, folder / "rig.toml")
    (folder / "run.toml").write_text(
        'persons = [{ name = "anna", stature_m = 1.75 }]\n'
        f'keypoints = {{ path = "{{view}}_json", layout = "{layout}" }}\n'
        '[reading]\nuse = "video"\npath = "{view}.mp4"\nrig = "rig.toml"\n'
    )
    return folder / "run.toml"


def lifted(height_m: float) -> Array:
    motion = np.eye(4)
    motion[2, 3] = height_m
    return motion


def test_keypoints_of_feet_tell_the_floor_roughly(tmp_path: Path) -> None:
    config = detected_walk(tmp_path, LAYOUTS["coco_17"], "coco_17")
    told = run("check", tmp_path / "rig.toml", "--floor", config)
    assert "resting keypoints of feet" in told
    assert "track with it, then let the result tell the floor" in told
    assert 0.49 < float(told.split("the floor is at ")[1].split(" m")[0]) < 0.55, "heels are raised in walking"
    config.write_text(config.read_text().replace("keypoints =", "# "))
    with pytest.raises(TrackerError, match=f"no keypoints there.*bodytrack detect {config}"):
        run("check", tmp_path / "rig.toml", "--floor", config)
