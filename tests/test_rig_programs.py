"""Calibrations of Vicon, Panoptic, FreeMoCap 2 and the first Caliscope, and files of others that are named."""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rig_samples import ANIPOSE, FREEMOCAP, NORTH, QUALISYS, assert_equal, easymocap, entries, sample_rig
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from tracker.cameras.camera import Camera
from tracker.cameras.rig_layouts import load_rig, read_rig, save_rig
from tracker.foundation.errors import CalibrationError
from tracker.running.cli import app

PLAIN = (0.0, 0.0, 0.0, 0.0, 0.0)
RADIAL = "Vicon3Parameter 650 352 4.1e-8 -6e-15 1e-21"


def vicon_camera(camera: Camera, radial: str = "", **attributes: str) -> str:
    """A camera as Vicon's Nexus writes it."""
    x, y, z = 1000 * camera.centre
    quaternion = " ".join(repr(v) for v in Rotation.from_matrix(camera.camera_from_world[:3, :3]).as_quat().tolist())
    told = {
        "ACTIVE_THRESHOLD": "0",
        "DEVICEID": camera.name,
        "DISPLAY_TYPE": "Vue",
        "NAME": "",
        "PIXEL_ASPECT_RATIO": repr(float(camera.matrix[0, 0] / camera.matrix[1, 1])),
        "SENSOR_SIZE": "1280 720",
        "SKEW": "0",
        "TYPE": "Vue_VIDEO",
        "USERID": "9",
        **attributes,
    }
    words = " ".join(f'{key}="{value}"' for key, value in told.items())
    lens = f' VICON_RADIAL2="{radial}"' if radial.startswith("Vicon") else f' VICON_RADIAL="{radial}"' if radial else ""
    return f"""  <Camera {words}>
    <ThresholdGrid BIT_DEPTH="1" DATA=""/>
    <ControlFrames/>
    <KeyFrames>
      <KeyFrame FOCAL_LENGTH="900" FRAME="0" IMAGE_ERROR="0.2" ORIENTATION="{quaternion}" POSITION="{x} {y} {z}"
       PRINCIPAL_POINT="640 360"{lens} WORLD_ERROR="0.5"/>
    </KeyFrames>
  </Camera>"""


def xcp(*cameras: str) -> str:
    head = '<?xml version="1.0" encoding="UTF-8" standalone="no" ?>\n<!-- Nexus -->\n<Cameras NAME="" VERSION="1.2">\n'
    return head + "\n".join(cameras) + "\n</Cameras>\n"


def test_cameras_of_vicon(tmp_path: Path) -> None:
    """Millimetres, the quaternion from the world to the camera; the ending does not matter."""
    rig = sample_rig("2111111", "2111112", lens=PLAIN)
    marker = vicon_camera(sample_rig("11").cameras[0], TYPE="DxCore41", DISPLAY_TYPE="T40-S")
    idle = '<Camera DEVICEID="12" TYPE="Vue_VIDEO" SENSOR_SIZE="1280 720"><KeyFrames/></Camera>'
    for name in ("session.xcp", "cameras.xml"):
        (tmp_path / name).write_text(xcp(*(vicon_camera(camera) for camera in rig.cameras), marker, idle))
        found = read_rig(tmp_path / name)
        assert (found.layout, found.unit, found.remarks) == ("vicon", "mm", ())
        assert_equal(found.rig, rig, 1e-9)
        assert "markers alone" in found.left_out["11"]
        assert "no <KeyFrame>" in found.left_out["12"]
    markers = [vicon_camera(one, TYPE="DxCore41", DISPLAY_TYPE="T40-S") for one in sample_rig("11", "12").cameras]
    (tmp_path / "markers.xcp").write_text(xcp(*markers))
    assert load_rig(tmp_path / "markers.xcp").names == ("11", "12")


def imaged_by_vicon(ideal: np.ndarray, centre: np.ndarray, radial: tuple[float, ...]) -> np.ndarray:
    """Pixels whose correction, `1 + k1 r^2 + k2 r^4 + k3 r^6` from the centre, are the ideal ones."""
    offsets = wanted = ideal - centre
    for _ in range(100):
        squares = (offsets**2).sum(axis=1, keepdims=True)
        offsets = wanted / (1 + sum(k * squares ** (n + 1) for n, k in enumerate(radial)))
    return centre + offsets


@pytest.mark.parametrize(
    ("told", "centre", "radial"),
    [
        (RADIAL, (650, 352), (4.1e-8, -6e-15, 1e-21)),
        ("Vicon3Parameter 640 360 -3e-8 0 0", (640, 360), (-3e-8, 0, 0)),
        ("4.1e-8 -6e-15", (640, 360), (4.1e-8, -6e-15)),
        ("Vicon3Parameter 640 360 0 0 0", (640, 360), (0, 0, 0)),
    ],
)
def test_a_lens_of_vicon_corrects_pixels(
    tmp_path: Path, told: str, centre: tuple[float, float], radial: tuple[float, ...]
) -> None:
    """The other way round than OpenCV's: to 0.2 px all over the image."""
    plain = sample_rig("1", lens=PLAIN).cameras[0]
    (tmp_path / "a.xcp").write_text(xcp(vicon_camera(plain, told)))
    camera = load_rig(tmp_path / "a.xcp").cameras[0]
    columns, rows = np.meshgrid(np.linspace(-0.69, 0.69, 31), np.linspace(-0.39, 0.39, 21))
    points = plain.centre + np.stack([columns, rows, np.ones_like(rows)], axis=-1).reshape(-1, 3) @ NORTH
    wanted = imaged_by_vicon(plain.project(points), np.array(centre, dtype=float), radial)
    inside = ((wanted >= 0) & (wanted <= (1279, 719))).all(axis=1)
    assert inside.sum() > 500
    np.testing.assert_allclose(camera.project(points)[inside], wanted[inside], atol=0.2)
    if any(radial):
        assert np.abs(plain.project(points) - wanted)[inside].max() > 5
    np.testing.assert_allclose(camera.matrix, plain.matrix, atol=2.0)


VICON_FAULTS = {
    "turns back": (("", "Vicon3Parameter 640 360 0 -1e-8 0"), "turns back inside the image"),
    "a word": (("", "Vicon3Parameter 640 360 a 0 0"), "VICON_RADIAL2 .*expected numbers"),
    "too many": (("", "Vicon9 640 360 0 0 0 0 0 0 0"), "expected a name, the centre"),
    "no focal length": (('FOCAL_LENGTH="900"', ""), "FOCAL_LENGTH .*0 numbers found, expected 1"),
    "not finite": (('FOCAL_LENGTH="900"', 'FOCAL_LENGTH="nan"'), "FOCAL_LENGTH: expected finite"),
    "negative": (('FOCAL_LENGTH="900"', 'FOCAL_LENGTH="-900"'), "FOCAL_LENGTH -900"),
    "no quaternion": ((r'ORIENTATION="[^"]*"', 'ORIENTATION="0 0 0 0"'), "length 0, expected"),
    "size": (('SENSOR_SIZE="1280 720"', 'SENSOR_SIZE="1280"'), "SENSOR_SIZE .*expected 2"),
    "moves": (("</KeyFrames>", '<KeyFrame FRAME="9"/></KeyFrames>'), "several <KeyFrame>"),
    "external": (("<Cameras", "<!DOCTYPE x SYSTEM 'file:///etc/passwd'>\n<Cameras"), "a document type"),
    "cut off": (("</Cameras>", ""), "not XML"),
    "empty": (("(?s)<Camera .*</Camera>", ""), "no <Camera>"),
}


@pytest.mark.parametrize("fault", VICON_FAULTS)
def test_a_fault_in_a_file_of_vicon(tmp_path: Path, fault: str) -> None:
    (old, new), words = VICON_FAULTS[fault]
    good = xcp(vicon_camera(sample_rig("1").cameras[0], new if not old else ""))
    (tmp_path / "a.xcp").write_text(re.sub(old, new, good, count=1) if old else good)
    with pytest.raises(CalibrationError, match=words):
        load_rig(tmp_path / "a.xcp")


def panoptic(units: str | None = None) -> dict[str, Any]:
    """A calibration of the Panoptic Studio, whose world has -y up: two cameras and one without a place."""
    cameras = [
        {
            "name": camera.name,
            "type": "hd",
            "resolution": [1280, 720],
            "panel": 0,
            "node": k,
            "K": camera.matrix.tolist(),
            "distCoef": camera.distortion[:5].tolist(),
            "R": camera.camera_from_world[:3, :3].tolist(),
            "t": (100 * camera.camera_from_world[:3, 3:]).tolist(),
        }
        for k, camera in enumerate(sample_rig("00_00", "00_01").with_up("y").cameras)
    ]
    lens = {key: value for key, value in cameras[0].items() if key not in "Rt"} | {"name": "01_01"}
    told = {"calibDataSource": "160906_pizza1", "cameras": [*cameras, lens]}
    return told if units is None else {"units": units, **told}


@pytest.mark.parametrize("units", [None, "cm"])
def test_cameras_of_panoptic(tmp_path: Path, units: str | None) -> None:
    (tmp_path / "calibration_160906_pizza1.json").write_text(json.dumps(panoptic(units)))
    found = read_rig(tmp_path / "calibration_160906_pizza1.json")
    assert (found.layout, found.unit) == ("panoptic", "cm")
    assert_equal(found.rig.with_up("-y"), sample_rig("00_00", "00_01"), 1e-9)
    assert "no pose" in found.left_out["01_01"]
    assert any("--up -y" in line for line in found.remarks)


FREEMOCAP_2 = (
    FREEMOCAP.replace("[cam_0]", "[0]")
    .replace("[cam_1]", "[1]")
    .replace('name = "A"', 'name = "A"\nid = "A"\nindex = 0')
    .partition("[metadata]")[0]
    + """[metadata]
groundplane_applied = true
reprojection_error_px = 0.61
n_observations_used = 15210
[metadata.board]
squares_x = 7
squares_y = 5
square_length_mm = 54.0
"""
)


def test_a_calibration_of_freemocap_2(tmp_path: Path) -> None:
    path = tmp_path / "session_camera_calibration.toml"
    path.write_text(FREEMOCAP_2)
    found = read_rig(path)
    assert (found.layout, found.unit, found.remarks) == ("freemocap", "mm", ())
    assert_equal(found.rig, sample_rig("A", "B"), 1e-12)
    path.write_text(FREEMOCAP_2.replace("applied = true", "applied = false"))
    assert "no ground plane" in read_rig(path).remarks[0]
    path.write_text(FREEMOCAP_2.replace("54.0", "1.0"))
    with pytest.raises(CalibrationError, match=r"square_length_mm = 1: .*squares of the board.*--scale METRES"):
        read_rig(path)
    assert_equal(read_rig(path, units="m", scale=0.001).rig, sample_rig("A", "B"), 1e-12)


CALISCOPE_FIRST = (
    ANIPOSE.partition("[metadata]")[0].replace("name =", "nickname =")
    + "\n[stereo_0_1]\nrotation = [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]\ntranslation = [[1.0], [0.0], [0.0]]\n"
)
for _port in (3, 4):
    CALISCOPE_FIRST = CALISCOPE_FIRST.replace(
        f"[cam_{_port - 3}]\n", f"[cam_{_port - 3}]\nport = {_port}\nignore = false\nrotation_count = 0\n"
    )


@pytest.mark.parametrize("points", [0, 20, 40_000])
def test_a_configuration_of_the_first_caliscope(tmp_path: Path, points: int) -> None:
    """Cameras, stereo pairs, the board and the points in one file, of which the points may be large."""
    lens = re.sub(r"(rotation|translation) = .*\n", "", CALISCOPE_FIRST.partition("[cam_1]")[0])
    found_points = ", ".join(["[0.25, -1.125, 2.0]"] * points)
    (tmp_path / "config.toml").write_text(
        "fps = 30\n[charuco]\ncolumns = 4\nrows = 5\n"
        + CALISCOPE_FIRST
        + lens.replace("cam_0", "cam_5").replace("port = 3", "port = 5")
        + f"[point_estimates]\nobj = [{found_points}]\n"
    )
    found = read_rig(tmp_path / "config.toml")
    assert found.layout == "caliscope"
    assert_equal(found.rig, sample_rig("port_3", "port_4"), 1e-12)
    assert set(found.left_out) == {"port_5"}


def test_a_table_without_size_and_matrix_is_no_camera(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(ANIPOSE + '\n[stereo_0_1]\nrotation = [0.0, 0.0, 1.0]\n[notes]\nby = "me"\n')
    assert load_rig(tmp_path / "rig.toml").names == ("A", "B")
    (tmp_path / "rig.toml").write_text("[stereo_0_1]\nrotation = [0.0, 0.0, 1.0]\n")
    with pytest.raises(CalibrationError, match=r"no camera in it, .*size and matrix; it has \[stereo_0_1\]"):
        load_rig(tmp_path / "rig.toml")


def test_lenses_without_a_pose_are_left_out_by_name_in_every_layout(tmp_path: Path) -> None:
    lens = {**entries()[0], "name": "LENS", "t": None}
    del lens["R"]
    (tmp_path / "rig.json").write_text(json.dumps({"cameras": [*entries(), lens]}))
    assert "no pose" in read_rig(tmp_path / "rig.json").left_out["LENS"]
    intri, extri = easymocap()
    (tmp_path / "intri.yml").write_bytes(intri.encode())
    posed = re.sub(r"(R|Rot|T)_02: !!opencv-matrix(\r\n  .*){4}\r\n", "", extri)
    (tmp_path / "extri.yml").write_bytes(posed.encode())
    assert set(read_rig(tmp_path).left_out) == {"02"}


@pytest.mark.parametrize(
    ("name", "content", "layout"),
    [
        ("rig.txt", ANIPOSE, "anipose"),
        ("rig", json.dumps({"cameras": entries()}), "json"),
        ("rig.toml", json.dumps({"cameras": entries()}), "json"),
        ("calibration.txt", QUALISYS, "qualisys"),
        ("calib", FREEMOCAP, "freemocap"),
        ("rig.json", xcp(*(vicon_camera(one) for one in sample_rig("1", "2").cameras)), "vicon"),
        ("camera.calib", json.dumps(panoptic()), "panoptic"),
    ],
)
def test_a_rig_is_recognized_by_its_content(tmp_path: Path, name: str, content: str, layout: str) -> None:
    (tmp_path / name).write_text(content)
    assert read_rig(tmp_path / name).layout == layout


OPENCV_XML = """<?xml version="1.0"?>
<opencv_storage>
<CameraMatrix type_id="opencv-matrix"><rows>3</rows><cols>4</cols><dt>d</dt><data>1 0 0 0 0 1 0 0 0 0 1 4</data>
</CameraMatrix>
<Intrinsics type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt><data>9 0 9 0 9 9 0 0 1</data></Intrinsics>
</opencv_storage>"""

OTHERS = {
    "cameras.txt": ("# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL\n1 PINHOLE 9 9 9", "COLMAP"),
    "cameras.bin": (struct.pack("<Q", 1), "COLMAP"),
    "bundle.out": ("# Bundle file v0.3\n2 90\n", "Bundler"),
    "transforms.json": ('{"fl_x": 9, "frames": [{"transform_matrix": [[1]]}]}', "NeRF"),
    "sfm_data.json": ('{"sfm_data_version": "0.3", "views": []}', "OpenMVG"),
    "cameras.sfm": ('{"version": ["1"], "views": [], "intrinsics": [], "poses": []}', "Meshroom"),
    "cameras.xml": ('<?xml version="1.0"?>\n<document version="1.5.0"><chunk label="1"/></document>', "Metashape"),
    "lens.xml": ("<calibration><projection>frame</projection><f>9</f></calibration>", "Metashape.*a lens and no pose"),
    "18000.xml": (OPENCV_XML, "OpenPose"),
    "stereo.xml": ("<?xml version='1.0'?><opencv_storage><K/></opencv_storage>", "OpenCV's XML"),
    "captury.calib": ("Skeletool Camera Calibration File V0\nname 0\n", "Captury"),
    "camchain.yaml": ("cam0:\n  camera_model: pinhole\n  intrinsics: [1, 2, 3, 4]\n", "Kalibr"),
    "cam0.yaml": ("image_width: 9\ncamera_matrix:\n  rows: 3\ndistortion_model: plumb_bob\n", "ROS"),
    "intrinsics.yml": ("%YAML:1.0\n---\nM1: 1\nD1: 1\nM2: 1\nD2: 1\n", "stereo_calib"),
    "extrinsics.yml": ("%YAML:1.0\n---\nR: 1\nT: 1\nR1: 1\n", "stereo_calib"),
    "run.toml": ('rig = "a"\n[reading]\nrig = "rig.toml"\n', "configuration of bodytrack"),
    "Config.toml": ('[project]\nframe_rate = "auto"\n[pose]\nmode = "x"\n', "Pose2Sim's configuration"),
    "hires_cam1_params.mat": (b"MATLAB 5.0 MAT-file, Platform: GLNXA64", "MATLAB"),
    "cameras.npz": (b"PK\x03\x04....", "archive"),
    "cameras.npy": (b"\x93NUMPY....", "numpy"),
    "cameras.pkl": (b"\x80\x04K\x01.", "pickle"),
    "trial.c3d": (b"\x02\x50", "movements"),
    "empty.toml": ("", "an empty file"),
    "left.yml": ("%YAML:1.0\n---\ncamera_matrix: 1\n", "one camera in OpenCV's YAML: give the folder"),
    "dltcoefs.csv": ("1.5,2e-3\n" * 11, "DLT coefficients"),
    "frame_0.json": ('{"version": 1.3, "people": []}', "keypoints as OpenPose"),
}


@pytest.mark.parametrize("name", OTHERS)
def test_files_of_other_programs_are_named(tmp_path: Path, name: str) -> None:
    content, words = OTHERS[name]
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(CalibrationError, match=words) as refusal:
        load_rig(path)
    assert str(path) in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("cameras.txt",), "COLMAP"),
        (("18000.xml",), "OpenPose"),
        (("cam0.yaml",), "ROS"),
        (("camchain.yaml",), "Kalibr"),
        (("intrinsics.yml", "extrinsics.yml"), "lenses of OpenCV's stereo_calib"),
    ],
)
def test_folders_of_other_programs_are_named(tmp_path: Path, names: tuple[str, ...], words: str) -> None:
    for name in names:
        (tmp_path / name).write_text(str(OTHERS[name][0]))
    with pytest.raises(CalibrationError, match=words):
        load_rig(tmp_path)


def test_a_folder_is_read_although_another_file_lies_in_it(tmp_path: Path) -> None:
    save_rig(sample_rig("A", "B"), tmp_path / "rig", "opencv")
    for name in ("cameras.txt", "stereo.xml", "captury.calib"):
        (tmp_path / "rig" / name).write_text(str(OTHERS[name][0]))
    assert load_rig(tmp_path / "rig").names == ("A", "B")


def test_a_reconstruction_of_colmap_in_its_folders(tmp_path: Path) -> None:
    (tmp_path / "sparse" / "0").mkdir(parents=True)
    for name in ("cameras.bin", "images.bin"):
        (tmp_path / "sparse" / "0" / name).write_bytes(bytes(8))
    for path in (tmp_path, tmp_path / "sparse" / "0"):
        with pytest.raises(CalibrationError, match="COLMAP"):
            load_rig(path)


def test_a_folder_that_has_a_calibration_names_it(tmp_path: Path) -> None:
    save_rig(sample_rig("A", "B"), tmp_path / "rig.toml")
    (tmp_path / "run.toml").write_text(str(OTHERS["run.toml"][0]))
    with pytest.raises(CalibrationError, match=r": give the path of the calibration in this folder: rig\.toml$"):
        load_rig(tmp_path)
    (tmp_path / "cameras.xml").write_text(str(OTHERS["cameras.xml"][0]))
    with pytest.raises(
        CalibrationError, match=r"Metashape.*; or give the path of the calibration in this folder: rig\.toml$"
    ):
        load_rig(tmp_path)


CASES = "cases"


@pytest.mark.parametrize(
    ("case", "names"),
    [
        ("17-freemocap-2/session_camera_calibration.toml", ("0", "1")),
        ("18-caliscope-old-config/config.toml", ("port_0", "port_1")),
        ("18-caliscope-old-config/with_points.toml", ("port_0", "port_1")),
        ("20-xml-of-others/vicon.xcp", ("2111111",)),
        ("20-xml-of-others/panoptic_cm.json", ("00_00",)),
    ],
)
def test_cases_that_are_read(data: Callable[[str], Path], case: str, names: tuple[str, ...]) -> None:
    rig = load_rig(data(f"{CASES}/{case}"))
    assert rig.names == names
    assert max(float(np.linalg.norm(camera.centre)) for camera in rig.cameras) < 6


@pytest.mark.parametrize(
    ("case", "words"),
    [
        ("17-freemocap-2/no_metadata_mm.toml", "2853 m apart.*--units mm"),
        ("20-xml-of-others/captury.calib", "Captury"),
        ("20-xml-of-others/colmap", "COLMAP"),
        ("20-xml-of-others/kalibr", "Kalibr"),
        ("20-xml-of-others/metashape.xml", "Metashape"),
        ("20-xml-of-others/opencv_stereo", "stereo_calib"),
        ("20-xml-of-others/openpose_xml", "OpenPose"),
        ("20-xml-of-others/ros", "ROS"),
        ("20-xml-of-others/transforms.json", "NeRF"),
    ],
)
def test_cases_that_are_named(data: Callable[[str], Path], case: str, words: str) -> None:
    with pytest.raises(CalibrationError, match=words):
        load_rig(data(f"{CASES}/{case}"))


def test_a_case_in_millimetres_is_read_as_told(data: Callable[[str], Path], tmp_path: Path) -> None:
    source, target = str(data(f"{CASES}/17-freemocap-2/no_metadata_mm.toml")), tmp_path / "rig.toml"
    told = CliRunner().invoke(app, ["rig", "convert", source, str(target), "--units", "mm"])
    assert told.exit_code == 0, told.output
    one, other = load_rig(target).cameras
    assert np.linalg.norm(one.centre - other.centre) == pytest.approx(2.853, abs=1e-3)
