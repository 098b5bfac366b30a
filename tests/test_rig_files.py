"""Rig files: exact round trips, the layouts that others write, and one clear line for every fault."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tracker.camera import Camera
from tracker.errors import CalibrationError
from tracker.rig import Rig
from tracker.rig_files import load_rig, save_rig

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


@settings(max_examples=60, deadline=None, database=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 5))
def test_round_trip(tmp_path_factory: pytest.TempPathFactory, seed: int, n: int) -> None:
    rig = Rig(tuple(some_camera(seed, k) for k in range(n)))
    path = tmp_path_factory.getbasetemp() / "round_trip.toml"
    save_rig(rig, path)
    assert_equal(load_rig(path), rig, 1e-9)


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
    "Rodrigues": (put(R=[0.1, 0.2, 0.3]), r"rotation 3"),
    "null": (put(t=[None, 0, 1]), r"t: expected finite numbers"),
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
    assert_refused(written(tmp_path, content, ".toml"), "1500 units apart, expected metres.*millimetres", "rig.toml")


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
        ("rig.yaml", "cameras: []", r'"\.yaml", expected \.toml or \.json'),
    ],
)
def test_a_file_of_another_kind(tmp_path: Path, name: str, content: str, reason: str) -> None:
    path = tmp_path / name
    path.write_text(content)
    assert_refused(path, reason, name)


def test_a_file_that_is_not_there_or_not_text(tmp_path: Path) -> None:
    assert_refused(tmp_path / "none.toml", "No such file", "none.toml")
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
