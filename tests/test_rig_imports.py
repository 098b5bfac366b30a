"""Calibrations of OpenCap and FreeMoCap, other worlds turned upright, and pickles that must not be run."""

from __future__ import annotations

import contextlib
import io
import os
import pickle
import pickletools
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rig_samples import FREEMOCAP, assert_equal, sample_rig
from typer.testing import CliRunner

from tracker.cameras.camera import Camera
from tracker.cameras.rig import AXES, Rig
from tracker.cameras.rig_layouts import load_rig, read_rig, save_rig
from tracker.cameras.rig_layouts.opencap import pickled_table
from tracker.foundation.errors import CalibrationError
from tracker.running.cli import app

SESSION = Path("OpenCapData_1/Videos")


def opencap_table(camera: Camera) -> dict[str, Any]:
    """What OpenCap pickles of a camera: lengths in mm, image size as height and width."""
    return {
        "distortion": camera.distortion[None],
        "intrinsicMat": np.asfortranarray(camera.matrix),
        "imageSize": np.array([[camera.size[1]], [camera.size[0]]], dtype=np.float64),
        "rotation": np.array(camera.camera_from_world[:3, :3]),
        "translation": 1000 * camera.camera_from_world[:3, 3:],
        "rotation_EulerAngles": camera.rotation_vector()[:, None],
    }


def as_numpy_1(content: bytes) -> bytes:
    """The pickle with the names that numpy had before its second version, with which OpenCap runs."""
    short = content.replace(b"cnumpy._core.", b"cnumpy.core.")  # followed by a line end, in the second and third
    told = re.sub(rb"\x8c(.)numpy._core", lambda m: b"\x8c" + bytes([m[1][0] - 1]) + b"numpy.core", short, flags=re.S)
    # the frame of the fourth protocol tells its length
    return re.sub(rb"\x95.{8}", lambda m: b"\x95" + (len(told) - m.end()).to_bytes(8, "little"), told, flags=re.S)


def session(folder: Path, protocol: int = 3, older: bool = False) -> Path:
    for camera in sample_rig("Cam0", "Cam1").cameras:
        file = folder / SESSION / camera.name / "cameraIntrinsicsExtrinsics.pickle"
        file.parent.mkdir(parents=True)
        content = pickle.dumps(opencap_table(camera), protocol)
        file.write_bytes(as_numpy_1(content) if older else content)
    return folder / SESSION.parent


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
@pytest.mark.parametrize("older", [False, True])
def test_a_session_of_opencap(tmp_path: Path, protocol: int, older: bool) -> None:
    folder = session(tmp_path, protocol, older)
    wanted = sample_rig("Cam0", "Cam1")
    file = folder / "Videos" / "Cam0" / "cameraIntrinsicsExtrinsics.pickle"
    assert not older or b"_core" not in file.read_bytes()
    pickletools.dis(file.read_bytes(), out=io.StringIO())  # what was made of it is a pickle
    for path in (folder, folder / "Videos", file):
        found = read_rig(path)
        assert found.layout == "opencap"
        assert_equal(found.rig, wanted, 1e-12)
        assert not found.remarks


class Harmful:
    """Makes a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.path),)


@pytest.mark.parametrize("protocol", range(6))
@pytest.mark.parametrize("deep", [False, True])
def test_a_pickle_that_asks_for_something_is_not_run(tmp_path: Path, protocol: int, deep: bool) -> None:
    folder = session(tmp_path)
    harm: Any = Harmful(tmp_path / "made")
    table = opencap_table(sample_rig("Cam0").cameras[0]) | {"rotation": harm}
    file = folder / "Videos" / "Cam0" / "cameraIntrinsicsExtrinsics.pickle"
    file.write_bytes(pickle.dumps(table if deep else harm, protocol))
    with pytest.raises(CalibrationError, match=r'camera "Cam0": camera.*pickle: ') as caught:
        read_rig(folder)
    assert not (tmp_path / "made").exists()
    assert "\n" not in str(caught.value)
    pickle.loads(file.read_bytes())
    assert (tmp_path / "made").exists()  # Python's own reader does as it is told


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"rotation": np.zeros((90, 90))}, r"shape \(90, 90\)"),
        ({"rotation": np.array(["a"])}, "expected numbers"),
        ({"rotation": np.array([None])}, "expected numbers"),
        ({1: 2.0}, "no table in it"),
        ([1.0], "is not read"),
        ({"rotation": pickle.Pickler}, "asks for _?pickle.Pickler"),
        ({"rotation": np.zeros(3).tolist}, "is not read"),
    ],
)
def test_pickles_of_something_else(table: Any, words: str) -> None:
    with pytest.raises(CalibrationError, match=words):
        pickled_table(pickle.dumps(table, 4))


GOOD = pickle.dumps(opencap_table(sample_rig("A").cameras[0]), 4)


@settings(max_examples=150, deadline=None)
@given(where=st.integers(0, len(GOOD) - 1), length=st.integers(0, 30), put=st.binary(max_size=12))
def test_a_damaged_pickle_is_read_or_refused(where: int, length: int, put: bytes) -> None:
    with contextlib.suppress(CalibrationError):
        pickled_table(GOOD[:where] + put + GOOD[where + length :])


def test_the_image_size_is_height_and_width(tmp_path: Path) -> None:
    folder = session(tmp_path)
    file = folder / "Videos" / "Cam1" / "cameraIntrinsicsExtrinsics.pickle"
    table = opencap_table(sample_rig("Cam1").cameras[0]) | {"imageSize": np.array([[600.0], [1000.0]])}
    del table["rotation"], table["translation"]
    file.write_bytes(pickle.dumps(table))
    found = read_rig(folder)
    assert dict(found.left_out) == {"Cam1": "has no pose: the board was not found in its images"}
    assert found.rig.cameras[0].size == (1280, 720)


def test_a_calibration_of_freemocap(tmp_path: Path) -> None:
    (tmp_path / "a_camera_calibration.toml").write_text(FREEMOCAP)
    found = read_rig(tmp_path / "a_camera_calibration.toml")
    assert (found.layout, found.remarks) == ("freemocap", ())
    assert_equal(found.rig, sample_rig("A", "B"), 1e-12)
    (tmp_path / "stated.toml").write_text(FREEMOCAP.replace("[metadata]", '[metadata]\nunits = "mm"'))
    assert_equal(load_rig(tmp_path / "stated.toml"), sample_rig("A", "B"), 1e-12)
    (tmp_path / "unknown.toml").write_text(FREEMOCAP.replace("58.0", "1"))
    with pytest.raises(CalibrationError, match=r"charuco_square_size = 1: .*in mm"):
        load_rig(tmp_path / "unknown.toml")
    with pytest.raises(CalibrationError, match="read only: choose the layout anipose"):
        save_rig(found.rig, tmp_path / "new.toml", "freemocap")


@pytest.mark.parametrize("vector", [False, True])
def test_opencv_files_with_the_names_of_its_parameters(tmp_path: Path, vector: bool) -> None:
    """K, D, R, T as programs write them with OpenCV, without the size of the images."""
    for camera in sample_rig("left", "right").cameras:
        storage = cv2.FileStorage(str(tmp_path / f"{camera.name}.yml"), cv2.FILE_STORAGE_WRITE)
        storage.write("K", camera.matrix)
        storage.write("D", camera.distortion[None])
        turn = camera.rotation_vector()[:, None] if vector else np.array(camera.camera_from_world[:3, :3])
        storage.write("rvec" if vector else "R", turn)
        storage.write("tvec" if vector else "T", np.array(camera.camera_from_world[:3, 3:]))
        storage.release()
    with pytest.raises(CalibrationError, match=r"left.yml: no image_width and image_height: .*--size WxH"):
        read_rig(tmp_path)
    assert_equal(read_rig(tmp_path, (1280, 720)).rig, sample_rig("left", "right"), 1e-12)


@pytest.mark.parametrize("up", AXES)
def test_a_world_is_turned_until_z_is_up(tmp_path: Path, up: str) -> None:
    """A point lies as high above the floor as it lay along the axis that is up, and is seen where it was."""
    upright = sample_rig("A", "B")
    turned = upright.with_up(up, 0.3)
    points = np.random.default_rng(0).normal(size=(20, 3))
    new = points @ turn_of(upright, turned).T + (0, 0, -0.3)
    along = points[:, "xyz".index(up[-1])] * (-1 if up[0] == "-" else 1)
    np.testing.assert_allclose(new[:, 2], along - 0.3, atol=1e-12)
    np.testing.assert_allclose(turned.project(new), upright.project(points), rtol=1e-9)


def turn_of(before: Rig, after: Rig) -> np.ndarray:
    return after.cameras[0].camera_from_world[:3, :3].T @ before.cameras[0].camera_from_world[:3, :3]


@pytest.mark.parametrize("up", AXES)
def test_which_axis_is_up_is_seen_from_the_cameras(tmp_path: Path, up: str) -> None:
    there = {"x": "-x", "-x": "x", "y": "-y", "-y": "y"}.get(up, up)  # back by the opposite quarter
    other = sample_rig("A", "B").with_up(there)
    assert other.likely_up == up
    assert_equal(other.with_up(up), sample_rig("A", "B"), 1e-12)
    save_rig(other, tmp_path / "a.toml")
    with (tmp_path / "a.toml").open("a") as file:
        file.write("charuco_square_size = 58.0\n")  # as FreeMoCap does, under the metadata
    command = ["rig", "convert", str(tmp_path / "a.toml"), str(tmp_path / "b.toml"), "--up", up, "--floor", "0.1"]
    told = CliRunner().invoke(app, command)
    assert told.exit_code == 0, told.output
    assert "turns it" not in told.output  # it is done already
    assert (f"--up {up}` turns it" in "".join(read_rig(tmp_path / "a.toml").told())) == (up != "z")
    assert_equal(load_rig(tmp_path / "b.toml"), sample_rig("A", "B").with_up("z", 0.1), 1e-9)


def test_an_axis_that_is_none(tmp_path: Path) -> None:
    save_rig(sample_rig("A"), tmp_path / "a.toml")
    told = CliRunner().invoke(app, ["rig", "convert", str(tmp_path / "a.toml"), str(tmp_path / "b.toml"), "--up", "up"])
    assert isinstance(told.exception, CalibrationError)
    assert re.search('"up" is no axis', str(told.exception))
    assert not (tmp_path / "b.toml").exists()
