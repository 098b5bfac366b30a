"""Calibrations with a fault: one clear line that names the file and the camera, whatever is wrong."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rig_samples import ANIPOSE, CALISCOPE, QUALISYS, assert_equal, easymocap, entries, sample_rig, tables, written

from tracker.cameras.rig_layouts import load_rig, save_rig
from tracker.foundation.errors import CalibrationError, TrackerError


def drop(key: str) -> Callable[[dict[str, Any]], None]:
    return lambda table: table.pop(key)


def put(**values: Any) -> Callable[[dict[str, Any]], None]:
    return lambda table: table.update(values)


def rename(old: str, new: str) -> Callable[[dict[str, Any]], None]:
    return lambda table: table.update({new: table.pop(old)})


TOML_FAULTS = {
    "fisheye of five": (put(fisheye=True, distortions=[0.1] * 5), r"distortions: 5 numbers of a fisheye.*four"),
    "fisheye without a focal length": (
        put(fisheye=True, matrix=[[0, 0, 640], [0, 0, 360], [0, 0, 1]]),
        r"focal length 0",
    ),
    "fisheye beyond any": (put(fisheye=True, distortions=[1e29, 0, 0, 0]), r"fisheye distortion .*1e\+29"),
    "fisheye that turns back": (put(fisheye=True, distortions=[-0.9, 0, 0, 0]), r"in one place \d+ px from"),
    "fisheye like no other": (put(fisheye=True, distortions=[0, 30, -300, 1200]), r"no quotient.*OpenCV's fisheye"),
    "no matrix": (drop("matrix"), r'no entry "matrix"'),
    "misspelt": (rename("translation", "translaton"), r'no entry "translation"; did you mean "translaton"'),
    "no rotation": (drop("rotation"), r'no entry "rotation"'),
    "no size": (drop("size"), r'no entry "size"'),
    "three sizes": (put(size=[1280, 720, 3]), r"size: \[1280\.0, 720\.0, 3\.0\] found, expected width and height"),
    "half a pixel": (put(size=[1280.5, 720]), r"size: \[1280\.5, .*whole px"),
    "not finite": (put(matrix=[[900, 0, 640], [float("nan"), 905, 360], [0, 0, 1]]), r"matrix: expected finite"),
    "a number too large": (put(translation=[0, 1e200, 5]), r"translation: expected numbers of a camera"),
    "short matrix": (put(matrix=[900, 0, 640]), r"matrix has 3"),
    "ragged matrix": (put(matrix=[[900, 0, 640], [0, 900], [0, 0, 1]]), r"matrix: expected numbers"),
    "words": (put(translation=["0", "a", "1"]), r"translation: expected numbers"),
    "words that are numbers": (put(translation=["0", "0", "1"]), r"translation: expected numbers"),
    "six lens terms": (put(distortions=[0.1] * 6), r"distortions: 6 numbers.*k1 k2 p1 p2"),
    "thin prism": (put(distortions=[0.1] * 12), r"distortions: 12 numbers.*without thin prism and tilt"),
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
    assert_refused(
        written(tmp_path, {"units": "parsec", "cameras": content}, ".json"), "valid: cm, dm, ft, in, m, mm", '"parsec"'
    )


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
    assert_refused(written(tmp_path, content, ".toml"), "1500 m apart, expected a room.*--units mm`", "rig.toml")


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
