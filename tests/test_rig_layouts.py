"""Rig layouts: exact round trips, files as others write them, and one clear line for every fault."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rig_samples import (
    ANIPOSE,
    CALISCOPE,
    CALISCOPE_OLD,
    NORTH,
    POSE2SIM,
    QUALISYS,
    assert_equal,
    easymocap,
    entries,
    qtm,
    qtm_camera,
    sample_rig,
    tables,
    written,
)
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from tracker.cameras.camera import Camera, rational_of
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import load_rig, read_rig, save_rig
from tracker.foundation.configuration.components import available, find
from tracker.foundation.errors import CalibrationError, ConfigError
from tracker.running.cli import app
from tracker.running.commands.rig import LAYOUTS


def some_camera(seed: int, k: int) -> Camera:
    rng = np.random.default_rng([seed, k])
    motion = np.eye(4)
    axis = rng.normal(size=3)
    angle = rng.choice([0.0, 1e-6, np.pi / 2, np.pi - 1e-6, np.pi, rng.uniform(0, np.pi)])
    motion[:3, :3] = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
    motion[:3, 3] = rng.uniform(-5, 5, 3)
    width, height = int(rng.integers(100, 4000)), int(rng.integers(100, 4000))
    fx, fy = rng.uniform(300, 3000, 2)
    matrix = np.array([[fx, rng.normal(), width / 2], [0, fy, height / 2], [0, 0, 1]])
    return Camera(f'cämera "{k}"', (width, height), matrix, rng.normal(0, 0.1, rng.choice([5, 8])), motion)


READ_ONLY = ("freemocap", "middlebury", "opencap", "panoptic", "vicon")
WRITTEN = [use for use in available("rig_layouts") if use not in READ_ONLY]
PLAIN_NAMES = ("easymocap", "opencv")
"""Layouts in which a name is part of a key of OpenCV's YAML, or of a file name."""


def target(folder: Path, use: str) -> Path:
    endings = find("rig_layouts", use).endings
    return folder / f"{use}_rig{endings[0] if endings else ''}"


def fitted(rig: Rig, use: str) -> Rig:
    """The rig as far as a layout can hold it."""
    cameras = rig.cameras
    if use in ("pose2sim", "qualisys"):
        n = 4 if use == "pose2sim" else 5
        cameras = tuple(replace(c, distortion=c.distortion[:n]) for c in cameras)
    if use in PLAIN_NAMES:
        cameras = tuple(replace(c, name=f"view_{k}") for k, c in enumerate(cameras))
    return Rig(cameras)


@pytest.mark.parametrize("use", WRITTEN)
@settings(max_examples=25, deadline=None, database=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 5))
def test_round_trip(tmp_path_factory: pytest.TempPathFactory, use: str, seed: int, n: int) -> None:
    rig = fitted(Rig(tuple(some_camera(seed, k) for k in range(n))), use)
    path = target(tmp_path_factory.mktemp("trip"), use)
    save_rig(rig, path, use)
    found = read_rig(path)
    assert_equal(found.rig, rig, 1e-9)
    assert found.layout == ("anipose" if use == "pose2sim" else use)
    detected = [one for one in available("rig_layouts") if find("rig_layouts", one)().detects(path)]
    assert detected == [found.layout]
    assert not list(path.parent.rglob("*.part"))


def test_the_names_of_the_layouts_are_in_the_help() -> None:
    assert tuple(LAYOUTS.split(", ")) == available("rig_layouts")


@pytest.mark.parametrize(("name", "use"), [("rig.toml", "anipose"), ("a.json", "json"), ("q.qca.txt", "qualisys")])
def test_the_name_of_the_target_tells_the_layout(tmp_path: Path, name: str, use: str) -> None:
    save_rig(sample_rig("A", "B"), tmp_path / name)
    assert read_rig(tmp_path / name).layout == use


@pytest.mark.parametrize(
    ("name", "use", "words"),
    [
        ("rig", None, "its name does not show the layout; name it: anipose, caliscope"),
        ("rig.toml", "qualysis", 'no layout "qualysis"; did you mean "qualisys"'),
        ("rig.toml", "qualisys", "a file that ends in .qca.txt or .xml"),
        ("taken", "opencv", "this layout is a folder, and a file is there"),
    ],
)
def test_a_layout_that_does_not_fit_its_target(tmp_path: Path, name: str, use: str | None, words: str) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(ConfigError, match=re.escape(words)):
        save_rig(sample_rig("A"), tmp_path / name, use)
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def test_rigs_that_a_layout_cannot_hold(tmp_path: Path) -> None:
    wide = replace(sample_rig("A").cameras[0], matrix=np.array([[300.0, 0, 640], [0, 300, 360], [0, 0, 1]]))
    fisheye = replace(wide, distortion=rational_of("A", wide.size, wide.matrix, np.zeros(4)))
    with pytest.raises(CalibrationError, match=r'"A": this layout holds the distortion k1 k2 p1 p2 alone.* px off.*at'):
        save_rig(Rig((fisheye,)), tmp_path / "rig.toml", "pose2sim")
    with pytest.raises(CalibrationError, match="read only"):
        save_rig(sample_rig("A"), tmp_path / "a_par.txt")
    with pytest.raises(CalibrationError, match="a name that no file can have"):
        save_rig(sample_rig(".A"), tmp_path / "folder", "opencv")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("file", "content", "names", "tolerance"),
    [
        ("calibration.toml", ANIPOSE, ("A", "B"), 1e-12),
        ("Calib_scene.toml", POSE2SIM, ("cam01", "cam02"), 1e-12),
        ("camera_array.toml", CALISCOPE, ("cam_0", "cam_1"), 1e-12),
        ("camera_array.toml", CALISCOPE_OLD, ("port_1", "port_10"), 1e-12),
        ("Calib.qca.txt", QUALISYS, ("26578", "26580"), 1e-12),
        ("Calib.xml", QUALISYS.replace("\n", "\r\n"), ("26578", "26580"), 1e-12),
    ],
)
def test_files_as_other_programs_write_them(
    tmp_path: Path, file: str, content: str, names: tuple[str, ...], tolerance: float
) -> None:
    (tmp_path / file).write_bytes(content.encode())
    assert_equal(load_rig(tmp_path / file), sample_rig(*names), tolerance)


@pytest.mark.parametrize("given_path", ["", "intri.yml", "extri.yml"])
def test_the_two_files_of_easymocap(tmp_path: Path, given_path: str) -> None:
    for name, content in zip(("intri.yml", "extri.yml"), easymocap(), strict=True):
        (tmp_path / name).write_bytes(content.encode())
    # EasyMocap writes six decimals.
    assert_equal(load_rig(tmp_path / given_path), sample_rig("01", "02"), 2e-6)
    bare = re.sub(r"[HW]_0\d: \d+\r\n", "", easymocap()[0]).replace('"01"', "1").replace("_01:", "_1:")
    (tmp_path / "intri.yml").write_bytes(bare.encode())
    (tmp_path / "extri.yml").write_bytes(easymocap()[1].replace("_01:", "_1:").encode())
    with pytest.raises(CalibrationError, match=r'"1": the file does not tell the image size.*--size WxH'):
        load_rig(tmp_path)
    assert_equal(read_rig(tmp_path, (1280, 720)).rig, sample_rig("1", "02"), 2e-6)


def test_cameras_that_cannot_be_used_are_left_out_and_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "camera_array.toml").write_text(CALISCOPE_OLD)
    found = read_rig(tmp_path / "camera_array.toml")
    assert found.left_out.keys() == {"port_2", "port_3"}
    assert "ignore = true" in found.left_out["port_2"]
    assert "no pose" in found.left_out["port_3"]
    with caplog.at_level(logging.WARNING, "tracker"):
        load_rig(tmp_path / "camera_array.toml")
    lines = [record.getMessage().partition(": ")[2] for record in caplog.records]
    assert lines[0] == 'left out: "port_2": is set aside: ignore = true'
    assert lines[1].startswith('left out: "port_3": has no pose')
    caplog.clear()
    assert load_rig(tmp_path / "camera_array.toml", ("port_10", "port_1")).names == ("port_10", "port_1")
    assert not caplog.records
    with pytest.raises(CalibrationError, match='"port_2" is set aside: ignore = true'):
        load_rig(tmp_path / "camera_array.toml", ("port_1", "port_2"))
    result = CliRunner().invoke(app, ["rig", "convert", str(tmp_path / "camera_array.toml"), str(tmp_path / "r.json")])
    assert result.exit_code == 0, result.output
    assert 'look: left out: "port_3": has no pose' in result.output


def test_a_rig_without_any_pose_is_an_error_that_says_so(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(re.sub(r"(rotation|translation) = .*\n", "", ANIPOSE))
    with pytest.raises(CalibrationError, match=r'no camera can be used; left out: "A", "B": has no pose') as caught:
        load_rig(path)
    assert "\n" not in str(caught.value)


def test_cameras_of_qtm_that_are_not_in_use(tmp_path: Path) -> None:
    cameras = [qtm_camera(str(k), 5000.0, 1500.0 * k) for k in range(2)]
    cameras += [qtm_camera("9", 0.0, 0.0, active="0"), qtm_camera("8", 0.0, 0.0, calibrated="false")]
    cameras += ['<camera active="1" serial="7" model="Miqus M3"/>']
    (tmp_path / "rig.xml").write_text(qtm(*cameras))
    found = read_rig(tmp_path / "rig.xml")
    assert_equal(found.rig, sample_rig("0", "1"), 1e-12)
    assert dict(found.left_out) == {"9": "is not active", "8": "is not calibrated", "7": "is not calibrated"}


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_cameras_of_qtm_mounted_turned(tmp_path: Path, quarters: int) -> None:
    """Read as they film, with a word about it; upright on request; `viewrotation` is written as it was read."""
    upright = sample_rig("A", "B", lens=(-0.2, 0.05, 0.01, -0.02, 0.01))
    films = Rig(tuple(camera.turned(-quarters) for camera in upright.cameras))
    save_rig(films, tmp_path / "rig.xml")
    assert f'viewrotation="{90 * quarters}"' in (tmp_path / "rig.xml").read_text()
    found = read_rig(tmp_path / "rig.xml")
    assert_equal(found.rig, films, 1e-9)
    assert all("mounted turned" in remark and "--upright" in remark for remark in found.remarks)
    assert len(found.remarks) == 2
    paths = str(tmp_path / "rig.xml"), str(tmp_path / "upright.toml")
    result = CliRunner().invoke(app, ["rig", "convert", *paths, "--upright"])
    assert result.exit_code == 0, result.output
    assert f"turned clockwise by {90 * quarters} degrees" in result.output
    assert_equal(load_rig(tmp_path / "upright.toml"), upright, 1e-9)


@settings(max_examples=40, deadline=None, database=None)
@given(seed=st.integers(0, 2**32 - 1), quarters=st.integers(-3, 4))
def test_a_turned_camera_shows_the_turned_image(seed: int, quarters: int) -> None:
    camera = some_camera(seed, 0)
    turned = camera.turned(quarters)
    points = (
        camera.centre
        + np.random.default_rng(seed).uniform((-0.4, -0.4, 1), (0.4, 0.4, 2), (20, 3))
        @ (camera.camera_from_world[:3, :3])
    )
    pixels, (width, height) = camera.project(points), camera.size
    for _ in range(quarters % 4):
        pixels, width, height = np.stack([height - 1 - pixels[:, 1], pixels[:, 0]], axis=1), height, width
    assert turned.size == (width, height)
    np.testing.assert_allclose(turned.project(points), pixels, atol=1e-6)
    np.testing.assert_allclose(turned.centre, camera.centre, atol=1e-9)


@pytest.mark.parametrize("quarters", range(4))
def test_how_a_camera_is_mounted_is_seen_from_its_pose(quarters: int) -> None:
    upright = sample_rig("A").cameras[0]
    assert upright.quarters_to_upright == 0
    assert upright.turned(-quarters).quarters_to_upright == quarters
    down = np.eye(4)
    down[:3, :3], down[2, 3] = np.diag([1.0, -1, -1]), 3.0
    assert replace(upright, camera_from_world=down).turned(quarters).quarters_to_upright == 0


def test_a_file_of_another_program(tmp_path: Path) -> None:
    rig = load_rig(written(tmp_path, tables(), ".toml"))
    assert rig.names == ("north", "south")
    north, south = rig.cameras
    assert north.size == (1280, 720)
    np.testing.assert_array_equal(north.distortion, [-0.2, 0.05, 0.001, -0.002, 0, 0, 0, 0])
    np.testing.assert_allclose(north.centre, (5, 0, 0), atol=1e-12)
    np.testing.assert_allclose(south.centre, (5, 1.5, 0), atol=1e-12)
    np.testing.assert_allclose(north.project(np.zeros(3)), (640, 360), atol=1e-9)
    assert south.project(np.array([0, 0, 0.2]))[1] < 360


FISHEYES = {"equidistant": (0.0, 0.0, 0.0, 0.0), "of a sports camera": (0.032, 0.011, -0.009, 0.0025)}


@pytest.mark.parametrize("lens", FISHEYES)
def test_a_fisheye_lens_images_as_opencv_has_it(tmp_path: Path, lens: str) -> None:
    """To 0.1 px within 74 degrees of the optical axis; and so does what is written of it."""
    content, coefficients = tables(), np.array(FISHEYES[lens])
    matrix = np.array([[480.0, 0, 650], [0, 482.0, 355], [0, 0, 1]])
    content["cam_1"] |= {"fisheye": True, "distortions": list(FISHEYES[lens]), "matrix": matrix.tolist()}
    camera = load_rig(written(tmp_path, content, ".toml")).cameras[0]
    rng = np.random.default_rng(0)
    angles, turns = np.radians(rng.uniform(0, 74, 2000)), rng.uniform(0, 2 * np.pi, 2000)
    plane = np.tan(angles)[:, None] * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    wanted = cv2.fisheye.distortPoints(plane[:, None], matrix, coefficients)[:, 0]
    local = np.concatenate([plane, np.ones((2000, 1))], axis=1)
    world = (local - camera.camera_from_world[:3, 3]) @ camera.camera_from_world[:3, :3]
    np.testing.assert_allclose(camera.project(world), wanted, atol=0.1)
    np.testing.assert_allclose(camera.undistort(wanted) / plane, 1, atol=1e-3)
    save_rig(Rig((camera,)), tmp_path / "again.toml")
    assert_equal(load_rig(tmp_path / "again.toml"), Rig((camera,)), 1e-12)


def test_a_fisheye_lens_of_opencv_s_sample(tmp_path: Path) -> None:
    """It is called fisheye_model there."""
    save_rig(sample_rig("A", lens=(0.03, 0.01, -0.01, 0.003)), tmp_path / "rig", "opencv")
    file = tmp_path / "rig/A.yml"
    plain = load_rig(tmp_path / "rig").cameras[0]
    numbers = re.sub(r"rows: 5(.*\n +cols: 1\n.*\n +data: \[.*), 0\.?[^,]*\]", r"rows: 4\1]", file.read_text())
    file.write_text(numbers + "fisheye_model: 1\n")
    bent = load_rig(tmp_path / "rig").cameras[0]
    assert plain.distortion[5:].tolist() == [0, 0, 0]
    assert bent.distortion[5] > 0.5


def test_distortion_of_fourteen_numbers_may_end_in_zeros(tmp_path: Path) -> None:
    content = tables()
    content["cam_1"]["distortions"] = [-0.2, 0.05, 0.001, -0.002, 0.1, 0.2, 0.3, 0.4, *[0.0] * 6]
    camera = load_rig(written(tmp_path, content, ".toml")).cameras[0]
    np.testing.assert_array_equal(camera.distortion, [-0.2, 0.05, 0.001, -0.002, 0.1, 0.2, 0.3, 0.4])


def test_a_table_is_named_by_its_key_where_it_has_no_name(tmp_path: Path) -> None:
    content = tables()
    del content["cam_1"]["name"]
    assert load_rig(written(tmp_path, content, ".toml")).names == ("cam_1", "south")


@pytest.mark.parametrize("use", ["anipose", "caliscope", "json"])
def test_a_camera_may_be_called_as_what_is_not_there(tmp_path: Path, use: str) -> None:
    names = ("null", "true", "nan", "metadata", "cameras")
    save_rig(sample_rig(*names), target(tmp_path, use), use)
    assert load_rig(target(tmp_path, use)).names == names


def test_both_json_layouts_hold_the_same_rig(tmp_path: Path) -> None:
    listed = load_rig(written(tmp_path, {"fps": 25, "cameras": entries()}, ".json"))
    by_name = {}
    for entry in entries():
        width, height = entry.pop("size")
        by_name[entry.pop("name")] = {"width": width, "height": height, **entry}
    assert_equal(load_rig(written(tmp_path, {"cameras": by_name}, ".json")), listed, 0.0)
    assert listed.names == ("FRONT", "SIDE")
    np.testing.assert_allclose(listed.cameras[0].centre, (4, 0, 0), atol=1e-12)


def test_json_and_toml_hold_the_same_rig(tmp_path: Path) -> None:
    rig = load_rig(written(tmp_path, {"cameras": entries()}, ".json"))
    save_rig(rig, tmp_path / "saved.toml")
    assert_equal(load_rig(tmp_path / "saved.toml"), rig, 1e-12)


def test_an_affine_correction_below_the_diagonal_keeps_the_images(tmp_path: Path) -> None:
    """K with a small K[1, 0] projects as before once its turn about the optical axis moved to R."""
    content = entries()
    matrix = np.array([[850.0, 1.5, 360], [-2.0, 848.0, 288], [0, 0, 1]])
    content[0] |= {"K": matrix.tolist(), "dist": [0.0] * 5}
    camera = load_rig(written(tmp_path, {"cameras": content}, ".json")).cameras[0]
    points = np.random.default_rng(0).uniform(-0.8, 0.8, (50, 3))
    rays = (points @ NORTH.T + (0, 0, 4)) @ matrix.T
    np.testing.assert_allclose(camera.project(points), rays[:, :2] / rays[:, 2:], atol=1e-9)


def test_saving_replaces_the_file_as_a_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "rig.toml"
    rig = Rig((some_camera(1, 0), some_camera(1, 1)))
    save_rig(rig, path)
    before = path.read_bytes()

    def full_disk(self: Path, content: bytes) -> int:
        with self.open("wb") as file:
            file.write(content[:40])
        raise OSError("no space left")

    monkeypatch.setattr(Path, "write_bytes", full_disk)
    with pytest.raises(OSError, match="no space"):
        save_rig(Rig((some_camera(2, 0),)), path)
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("recording", "n_cameras"),
    [
        ("balancing/calibration_balancing.json", 4),
        ("balancing/calibration_static.json", 4),
        ("two_people/calibration.json", 4),
        ("calib4/calibration_caliscope.json", 4),
        ("room/N-WalkCircle/calibration.json", 4),
        ("room/bar/calibration.json", 4),
    ],
)
def test_calibrations_of_recordings(
    data: Callable[[str], Path], tmp_path: Path, recording: str, n_cameras: int
) -> None:
    rig = load_rig(data(recording))
    assert len(rig) == n_cameras
    save_rig(rig, tmp_path / "rig.toml")
    assert_equal(load_rig(tmp_path / "rig.toml"), rig, 1e-8)


def test_a_calibration_fits_its_recording(data: Callable[[str], Path]) -> None:
    """The known joints of the walker lie inside the images, and triangulate to where they are."""
    rig = load_rig(data("room/D-TwoElbowRot/calibration.json"))
    table = np.genfromtxt(data("room/D-TwoElbowRot/gt_joints.csv"), delimiter=",", skip_header=1, usecols=(-3, -2, -1))
    pixels = rig.project(table)
    assert (np.abs(pixels - rig.sizes[:, None] / 2) < rig.sizes[:, None] / 2).all()
    np.testing.assert_allclose(rig.triangulate(pixels)[0], table, atol=1e-8)
