"""Rig layouts: exact round trips, files as others write them, and one clear line for every fault."""

from __future__ import annotations

import json
import logging
import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st
from rig_samples import (
    ANIPOSE,
    CALISCOPE,
    CALISCOPE_OLD,
    POSE2SIM,
    QUALISYS,
    easymocap,
    qtm,
    qtm_camera,
    sample_rig,
)
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from tracker.camera import Camera
from tracker.cli import app
from tracker.commands.rig import LAYOUTS
from tracker.components import available, find
from tracker.errors import CalibrationError, ConfigError, TrackerError
from tracker.rig import Rig
from tracker.rig_layouts import load_rig, read_rig, save_rig

ROTATION = np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]])
"""A camera on the x axis that looks at the origin, z up."""


def tables() -> dict[str, dict[str, Any]]:
    """Two cameras in the exchanged TOML layout, as other programs write it."""
    common = {
        "size": [1280.0, 720.0],
        "matrix": [[900.0, 0.0, 640.0], [0.0, 905.0, 360.0], [0.0, 0.0, 1.0]],
        "distortions": [-0.2, 0.05, 0.001, -0.002],
        "rotation": cv2.Rodrigues(ROTATION)[0].ravel().tolist(),
        "fisheye": False,
    }
    return {
        "cam_1": {"name": "north", **common, "translation": [0.0, 0.0, 5.0]},
        "cam_2": {"name": "south", **common, "translation": [-1.5, 0.0, 5.0], "error": 0.31},
        "metadata": {"adjusted": False, "error": 0.0},
    }


def entries() -> list[dict[str, Any]]:
    """Two cameras in the JSON layout."""
    common = {
        "size": [720, 576],
        "K": [[850.0, 0, 360], [0, 850.0, 288], [0, 0, 1]],
        "dist": [0.1, 0.02, 0, 0, 0.003],
        "R": ROTATION.tolist(),
    }
    return [{"name": "FRONT", **common, "t": [0, 0, 4.0]}, {"name": "SIDE", **common, "t": [1.0, 0, 4.0]}]


def written(folder: Path, content: Any, suffix: str) -> Path:
    path = folder / f"rig{suffix}"
    path.write_text(tomli_w.dumps(content) if suffix == ".toml" else json.dumps(content))
    return path


def assert_equal(one: Rig, other: Rig, tolerance: float) -> None:
    assert one.names == other.names
    for a, b in zip(one.cameras, other.cameras, strict=True):
        assert a.size == b.size
        np.testing.assert_allclose(a.matrix, b.matrix, atol=tolerance)
        np.testing.assert_allclose(a.distortion, b.distortion, atol=tolerance)
        np.testing.assert_allclose(a.camera_from_world, b.camera_from_world, atol=tolerance)


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
    return Camera(f'cämera "{k}"', (width, height), matrix, rng.normal(0, 0.1, 5), motion)


WRITTEN = [use for use in available("rig_layouts") if use != "middlebury"]
PLAIN_NAMES = ("easymocap", "opencv")
"""Layouts in which a name is part of a key of OpenCV's YAML, or of a file name."""


def target(folder: Path, use: str) -> Path:
    endings = find("rig_layouts", use).endings
    return folder / f"{use}_rig{endings[0] if endings else ''}"


def fitted(rig: Rig, use: str) -> Rig:
    """The rig as far as a layout can hold it."""
    cameras = rig.cameras
    if use == "pose2sim":
        cameras = tuple(replace(c, distortion=np.append(c.distortion[:4], 0.0)) for c in cameras)
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
        ("rig", None, "its name does not tell the layout; name it: anipose, caliscope"),
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
    with pytest.raises(CalibrationError, match=r"k3 of A .*four distortion coefficients"):
        save_rig(sample_rig("A", lens=(0.1, 0, 0, 0, 0.1)), tmp_path / "rig.toml", "pose2sim")
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
    np.testing.assert_array_equal(north.distortion, [-0.2, 0.05, 0.001, -0.002, 0])
    np.testing.assert_allclose(north.centre, (5, 0, 0), atol=1e-12)
    np.testing.assert_allclose(south.centre, (5, 1.5, 0), atol=1e-12)
    np.testing.assert_allclose(north.project(np.zeros(3)), (640, 360), atol=1e-9)
    assert south.project(np.array([0, 0, 0.2]))[1] < 360


def test_a_table_is_named_by_its_key_where_it_has_no_name(tmp_path: Path) -> None:
    content = tables()
    del content["cam_1"]["name"]
    assert load_rig(written(tmp_path, content, ".toml")).names == ("cam_1", "south")


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
    rays = (points @ ROTATION.T + (0, 0, 4)) @ matrix.T
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


def drop(key: str) -> Callable[[dict[str, Any]], None]:
    return lambda table: table.pop(key)


def put(**values: Any) -> Callable[[dict[str, Any]], None]:
    return lambda table: table.update(values)


def rename(old: str, new: str) -> Callable[[dict[str, Any]], None]:
    return lambda table: table.update({new: table.pop(old)})


TOML_FAULTS = {
    "fisheye": (put(fisheye=True), r"fisheye.*undistort"),
    "no matrix": (drop("matrix"), r'no entry "matrix"'),
    "misspelt": (rename("translation", "translaton"), r'no entry "translation"; did you mean "translaton"'),
    "no rotation": (drop("rotation"), r'no entry "rotation"'),
    "no size": (drop("size"), r'no entry "size"'),
    "three sizes": (put(size=[1280, 720, 3]), r"size: \[1280\.0, 720\.0, 3\.0\] found, expected width and height"),
    "half a pixel": (put(size=[1280.5, 720]), r"size: \[1280\.5, .*whole px"),
    "not finite": (put(matrix=[[900, 0, 640], [float("nan"), 905, 360], [0, 0, 1]]), r"matrix: expected finite"),
    "short matrix": (put(matrix=[900, 0, 640]), r"matrix has 3"),
    "ragged matrix": (put(matrix=[[900, 0, 640], [0, 900], [0, 0, 1]]), r"matrix: expected numbers"),
    "words": (put(translation=["0", "a", "1"]), r"translation: expected numbers"),
    "words that are numbers": (put(translation=["0", "0", "1"]), r"translation: expected numbers"),
    "eight lens terms": (put(distortions=[0.1] * 8), r"distortions: 8 numbers.*k1 k2 p1 p2"),
    "short rotation": (put(rotation=[0.1, 0.2]), r"rotation 2"),
    "not a rotation": (put(rotation=[[1, 0, 0], [0, 1, 0], [0, 0, -1]]), r"not a rotation"),
    "focal length": (put(matrix=[[-900, 0, 640], [0, 905, 360], [0, 0, 1]]), r"focal length -900"),
    "another image size": (put(size=[320, 180]), r"far outside the 320x180 image"),
    "transposed matrix": (put(matrix=[[900, 0, 0], [0, 905, 0], [640, 360, 1]]), r"intrinsic matrix"),
}


@pytest.mark.parametrize("fault", TOML_FAULTS)
def test_a_fault_in_toml_names_file_and_camera(tmp_path: Path, fault: str) -> None:
    change, reason = TOML_FAULTS[fault]
    content = tables()
    change(content["cam_2"])
    assert_refused(written(tmp_path, content, ".toml"), reason, '"south"')


JSON_FAULTS = {
    "no K": (rename("K", "k"), r'no entry "K"'),
    "no R": (drop("R"), r'no entry "R"'),
    "short rotation": (put(R=[0.1, 0.2]), r"R 2 "),
    "words": (put(t=["0", "0", "1"]), r"t: expected numbers"),
    "truth values": (put(t=[True, False, True]), r"t: expected numbers"),
    "a number too long": (put(t=[10**400, 0, 1]), r"t: expected numbers"),
    "a huge size": (put(size=[1e12, 576]), r"size: .*whole px"),
    "null": (put(t=[None, 0, 1]), r"t: expected numbers"),
    "no height": (put(width=720), r'no entry "height"'),
    "three lens terms": (put(dist=[0.1, 0, 0]), r"dist: 3 numbers"),
}


@pytest.mark.parametrize("fault", JSON_FAULTS)
def test_a_fault_in_json_names_file_and_camera(tmp_path: Path, fault: str) -> None:
    change, reason = JSON_FAULTS[fault]
    content = entries()
    change(content[1])
    assert_refused(written(tmp_path, {"cameras": content}, ".json"), reason, '"SIDE"')


@pytest.mark.parametrize("cameras", [[1, 2], {"SIDE": [0, 1]}, ["SIDE"]])
def test_cameras_that_are_no_tables(tmp_path: Path, cameras: Any) -> None:
    assert_refused(written(tmp_path, {"cameras": cameras}, ".json"), r"found, expected a table", "rig.json")


def test_stated_units_are_honoured(tmp_path: Path) -> None:
    content = entries()
    metres = load_rig(written(tmp_path, {"units": "m", "cameras": content}, ".json"))
    for entry in content:
        entry["t"] = [1000 * value for value in entry["t"]]
    assert_equal(load_rig(written(tmp_path, {"units": "mm", "cameras": content}, ".json")), metres, 1e-12)
    other = tables() | {"metadata": {"units": "cm"}}
    for key in ("cam_1", "cam_2"):
        other[key]["translation"] = [100 * value for value in other[key]["translation"]]
    north = load_rig(written(tmp_path, other, ".toml")).cameras[0]
    np.testing.assert_allclose(north.centre, (5, 0, 0), atol=1e-12)
    assert_refused(written(tmp_path, {"units": "inch", "cameras": content}, ".json"), "valid: cm, m, mm", '"inch"')


def test_two_cameras_at_one_place(tmp_path: Path) -> None:
    content = tables()
    content["cam_2"]["translation"] = content["cam_1"]["translation"]
    assert_refused(written(tmp_path, content, ".toml"), "north.*south.*one place", "rig.toml")


def test_a_name_given_twice(tmp_path: Path) -> None:
    content = entries()
    content[1]["name"] = "FRONT"
    assert_refused(written(tmp_path, {"cameras": content}, ".json"), "two cameras", '"FRONT"')


def test_millimetres_are_noticed(tmp_path: Path) -> None:
    content = tables()
    for key in ("cam_1", "cam_2"):
        content[key]["translation"] = [1000 * value for value in content[key]["translation"]]
    assert_refused(written(tmp_path, content, ".toml"), "1500 m apart, expected a room.*millimetres", "rig.toml")


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("rig.toml", "[cam_0\nname = 1", "not a TOML file"),
        ("rig.json", '{"cameras": [', "not a JSON file"),
        ("rig.json", "[1, 2]", "expected a table"),
        ("rig.json", '{"camera": []}', 'no entry "cameras"; did you mean "camera"'),
        ("rig.json", '{"cameras": 3}', "expected a list"),
        ("rig.json", '{"cameras": []}', "no camera"),
        ("rig.toml", "[metadata]\nerror = 0", "no camera"),
        ("rig.yaml", "cameras: []", "not a calibration that is known, expected a .toml with a table a camera"),
        ("rig.toml", "a" * 20_000, "a line of 20000 characters"),
        ("rig.toml", "#" + "\n" * 2**20, "larger than 1 MiB"),
        ("rig.toml", "a = " + "[\n" * 50_000, "nested too deeply"),
        ("rig.toml", f"a = {'1' * 5000}", "not a TOML file"),
        ("rig.toml", "metadata = 3", "metadata: 3 found"),
        ("rig.toml", "cameras = 3", "cameras: expected the tables"),
        ("rig.toml", "[cameras]\n0 = 3", "cameras.0: 3 found, expected a table"),
        ("rig.toml", "[cameras]", "no camera"),
        ("rig.json", "[" * 200_000, "nested too deeply"),
        ("rig.json", "1" * 5000, "not a JSON file"),
        ("a.qca.txt", "<calibration>", "not XML"),
        ("a.qca.txt", "<!DOCTYPE x><calibration/>", "document type"),
        ("a.qca.txt", "<calibration/>", "no <camera>"),
        ("a.qca.txt", QUALISYS.replace('focalLengthU="57600.000000"', "", 1), '"26578": <intrinsic> lacks a number'),
        ("a.qca.txt", QUALISYS.replace('"57600.000000"', '"nan"', 1), '"26578": <intrinsic> has numbers .* not finite'),
        ("a.qca.txt", re.sub("<fov_video .*?/>", "", QUALISYS), '"26578": no <fov_video>.*Theia'),
        ("a.qca.txt", QUALISYS.replace('viewrotation="0"', 'viewrotation="45"', 1), '"45", expected 0, 90, 180 or 270'),
        ("a.qca.txt", QUALISYS.replace('right="1279"', 'right="1e300"'), "size: .*whole px"),
        ("folder/a.yml", "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\n", "a.yml: no matrix camera_matrix"),
        ("folder/a.yml", "%YAML:1.0\n---\nx: 1\n", "a.yml: no image_width"),
        ("folder/a.yml", "%YAML:1.0\n---\n- 1\n- 2\n", "a.yml: not an OpenCV YAML file: no entries"),
        ("folder/a.yml", "image_width: 640\n", "a.yml: not an OpenCV YAML file, which starts with %YAML"),
        ("folder/a.yml", "", "a.yml: not an OpenCV YAML file"),
        ("folder/a.yml", "%YAML:1.0\n---\na: [1, 2\nb: [", "a.yml: not an OpenCV YAML file"),
        ("folder/a.yml", "%YAML:1.0\n---\na: " + "[" * 500_000, "a.yml: not an OpenCV YAML file"),
        ("folder/intri.yml", '%YAML:1.0\n---\nnames:\n  - "01"\n', "extri.yml: cannot read.*No such file"),
    ],
)
def test_a_file_of_another_kind(tmp_path: Path, name: str, content: str, reason: str) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(content)
    begin = time.process_time()
    assert_refused(path if path.parent == tmp_path else path.parent, reason, path.parent.name)
    assert time.process_time() - begin < 5


@pytest.mark.parametrize(
    "matrix",
    [
        "!!opencv-matrix\n  rows: 100000\n  cols: 100000\n  dt: d\n  data: [1.0]",
        "!!opencv-matrix\n  rows: 3\n  cols: 3\n  dt: d\n  data: [1.0]",
        "!!opencv-matrix\n  rows: -3\n  cols: -3\n  dt: d\n  data: [1.0]",
        "!!opencv-matrix\n  rows: 3\n  cols: 1\n  dt: q\n  data: [1.0, 2.0, 3.0]",
        "!!opencv-matrix\n  rows: 3\n  cols: 1\n  dt: d\n  data: [1.0, .Nan, 3.0]",
        "[1.0, 2.0, 3.0]",
        "3",
    ],
)
def test_a_matrix_that_is_none(tmp_path: Path, matrix: str) -> None:
    """Also one that OpenCV would allocate 80 GB for."""
    intri, extri = easymocap()
    damaged = re.sub(r"R_02: !!opencv-matrix(\r\n  .*){4}", f"R_02: {matrix}", extri)
    assert damaged != extri
    (tmp_path / "intri.yml").write_bytes(intri.encode())
    (tmp_path / "extri.yml").write_bytes(damaged.encode())
    assert_refused(tmp_path, "extri.yml: R_02: expected a matrix of finite numbers", tmp_path.name)


SAMPLES = {
    "calibration.toml": ANIPOSE,
    "camera_array.toml": CALISCOPE,
    "rig.qca.txt": QUALISYS,
    "rig.json": json.dumps({"units": "m", "cameras": entries()}),
    "mocap/intri.yml": easymocap()[0],
    "opencv/A.yml": "",
}


@pytest.mark.parametrize("name", SAMPLES)
@settings(max_examples=60, deadline=None, database=None)
@given(where=st.floats(0, 1), length=st.integers(0, 40), text=st.text(max_size=12))
def test_a_damaged_file_is_read_or_refused_in_one_line(
    tmp_path_factory: pytest.TempPathFactory, name: str, where: float, length: int, text: str
) -> None:
    """A piece cut out of a good file and other text in its place: never another error than ours."""
    path = tmp_path_factory.getbasetemp() / "damaged" / name
    path.parent.mkdir(parents=True, exist_ok=True)
    if name.startswith("mocap"):
        path.with_name("extri.yml").write_bytes(easymocap()[1].encode())
    if name.startswith("opencv"):
        save_rig(sample_rig("A"), path.parent, "opencv")
    good = SAMPLES[name] or path.read_text()
    begin = round(where * len(good))
    path.write_bytes((good[:begin] + text + good[begin + length :]).encode("utf-8", "surrogatepass"))
    message = f"{path.parent}"
    try:
        load_rig(path if path.parent.name == "damaged" else path.parent)
    except TrackerError as error:
        message = str(error)
    assert "\n" not in message
    assert str(path.parent) in message


def test_a_file_that_is_not_there_or_not_text(tmp_path: Path) -> None:
    assert_refused(tmp_path / "none.toml", "no such file or folder", "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00\x81")
    assert_refused(tmp_path / "binary.toml", "not a text file", "binary.toml")


def assert_refused(path: Path, reason: str, name: str) -> None:
    with pytest.raises(CalibrationError, match=reason) as refusal:
        load_rig(path)
    message = str(refusal.value)
    assert message.startswith(str(path))
    assert name in message
    assert "\n" not in message


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
