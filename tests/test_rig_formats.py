"""Calibrations of other programs, there and back; the looks that a rig check takes."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from bars import recorded
from typer.testing import CliRunner

from tracker.cli import app
from tracker.errors import CalibrationError
from tracker.rig import Rig
from tracker.rig_check import check_points, check_rig, epipolar_picture
from tracker.rig_files import load_rig, save_rig
from tracker.rig_formats import LAYOUTS, export_rig, import_rig

QUALISYS = """<calibration><cameras>
<camera active="1" avg-residual="0.5" serial="26580" model="Miqus Video">
<fov_video left="0" top="0" right="1919" bottom="1087"/>
<transform x="4263.3" y="2283.8" z="1794.3" r11="0" r12="1" r13="0" r21="0" r22="0" r23="1" r31="1" r32="0" r33="0"/>
<intrinsic focallength="9.27" sensorMinU="0" sensorMaxU="122879" sensorMinV="0" sensorMaxV="69631"
 focalLengthU="107872.609375" focalLengthV="107880.257813" centerPointU="60827.273438" centerPointV="32684.021484"
 skew="0" radialDistortion1="-0.045450" radialDistortion2="0.139604" radialDistortion3="0"
 tangentalDistortion1="0.000615" tangentalDistortion2="-0.000391"/>
</camera></cameras></calibration>"""


def rig(k3: bool = True) -> Rig:
    found = recorded(0, 4).rig
    if k3:
        return found
    return Rig(tuple(replace(c, distortion=np.append(c.distortion[:4], 0.0)) for c in found.cameras))


def target(folder: Path, layout: str) -> Path:
    return folder / {"qualisys": "rig.qca.txt", "opencv": "rig", "easymocap": "rig"}.get(layout, "rig.toml")


@pytest.mark.parametrize("layout", LAYOUTS)
def test_there_and_back(tmp_path, layout):
    before = rig(k3=layout != "pose2sim")
    export_rig(before, target(tmp_path, layout), layout)
    after = import_rig(target(tmp_path, layout))
    assert set(after.names) == set(before.names)
    points = np.random.default_rng(0).uniform((-1, -1, 0), (1, 1, 2), (20, 3))
    after = after.select(before.names)
    np.testing.assert_allclose(after.project(points), before.project(points), atol=1e-5)
    assert [camera.size for camera in after.cameras] == [camera.size for camera in before.cameras]


def test_a_qualisys_file(tmp_path):
    """Pixels in 64ths, plain distortion, millimetres, a camera frame with y up that looks along -z."""
    path = tmp_path / "session.qca.txt"
    path.write_text(QUALISYS)
    camera = import_rig(path).cameras[0]
    assert (camera.name, camera.size) == ("26580", (1920, 1088))
    assert camera.matrix[0, 0] == pytest.approx(1685.51, abs=0.01)
    np.testing.assert_allclose(camera.distortion, [-0.04545, 0.139604, 0.000615, -0.000391, 0])
    np.testing.assert_allclose(camera.centre, (4.2633, 2.2838, 1.7943), atol=1e-9)
    np.testing.assert_allclose(camera.camera_from_world[:3, :3], [[0, 1, 0], [0, 0, -1], [-1, 0, 0]], atol=1e-12)


def test_pose2sim_cannot_hold_k3(tmp_path):
    with pytest.raises(CalibrationError, match=r"k3 of .*four distortion coefficients"):
        export_rig(rig(), tmp_path / "rig.toml", "pose2sim")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.qca.txt", "<calibration>", "not XML"),
        ("a.qca.txt", "<!DOCTYPE x><calibration/>", "document type"),
        ("a.qca.txt", "<calibration/>", "no <camera>"),
        ("a.qca.txt", QUALISYS.replace('focalLengthU="107872.609375"', ""), "lacks a number"),
        ("a.csv", "x", "not a calibration that is known"),
        ("folder/a.yml", "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\n", "no matrix rotation"),
        ("folder/a.yml", "%YAML:1.0\n---\nx: 1\n", "no image_width"),
        ("folder/intri.yml", '%YAML:1.0\n---\nnames:\n  - "01"\n', "extri.yml: cannot be read"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, name, content, words):
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(content)
    with pytest.raises(CalibrationError, match=re.escape(words)) as caught:
        import_rig(path.parent if path.parent != tmp_path else path)
    assert "\n" not in str(caught.value)


def test_easymocap_of_others_does_not_tell_the_size(tmp_path):
    export_rig(rig(), tmp_path, "easymocap")
    intri = tmp_path / "intri.yml"
    intri.write_text("\n".join(line for line in intri.read_text().splitlines() if not re.match("[WH]_", line)) + "\n")
    with pytest.raises(CalibrationError, match="--size"):
        import_rig(tmp_path)
    assert import_rig(tmp_path, (768, 576)).cameras[0].size == (768, 576)


def test_a_good_rig_raises_no_doubt():
    check = check_rig(rig())
    assert not check.doubts
    assert check.sigma_mm < 5
    np.testing.assert_allclose(check.middle_m, (0, 0, 1), atol=0.2)
    assert len(check.pairs) == 6
    assert all(pair.shared > 0.5 for pair in check.pairs)


@pytest.mark.parametrize(("scale", "turn", "words"), [(0.01, False, "units metres"), (1.0, True, "upside down")])
def test_an_odd_rig_raises_doubts(scale, turn, words):
    cameras = []
    for camera in rig().cameras:
        motion = np.array(camera.camera_from_world)
        motion[:3, 3] *= scale
        cameras.append(replace(camera, camera_from_world=np.diag([-1.0, -1, 1, 1]) @ motion if turn else motion))
    assert any(words in doubt for doubt in check_rig(Rig(tuple(cameras))).doubts)


def test_points_tell_reprojection_and_scale():
    before = rig()
    points = np.random.default_rng(0).uniform((-1, -1, 0), (1, 1, 2), (20, 3))
    pixels = before.project(points)
    pixels[0] += 3.0
    found = check_points(before, 1.25 * points, pixels)
    assert found.rms_px["north_east"] > 1
    assert found.scale == pytest.approx(0.8, abs=0.01)
    with pytest.raises(CalibrationError, match="no point"):
        check_points(before, points, np.full_like(pixels, np.nan))


def test_epipolar_lines_pass_through_what_the_points_show():
    """Bright squares at known places: the lines of one view's squares go through the others'."""
    before = recorded(0, 4, around=False).rig
    points = np.array([(0.0, 2.5, 1.2), (0.25, 2.4, 1.3), (-0.3, 2.6, 1.1)])
    images = []
    for camera in before.cameras:
        image = np.zeros((576, 768, 3), np.uint8)
        for u, v in camera.project(points).round().astype(int):
            cv2.rectangle(image, (u - 4, v - 4), (u + 4, v + 4), (255, 255, 255), -1)
        images.append(image)
    picture = epipolar_picture(before, tuple(images), 1)
    assert picture.shape == (1200, 1600, 3)
    for k, pixel in enumerate(before.cameras[1].project(points)):
        line = before.epipolar_line(pixel, 1, 0, 400)
        wanted = before.cameras[0].project(points[k])
        assert np.linalg.norm(line - wanted, axis=1).min() < 2.0
    with pytest.raises(CalibrationError, match="calibrated at 768x576"):
        epipolar_picture(before, tuple(image[::2, ::2] for image in images))


def test_the_commands(tmp_path):
    save_rig(rig(), tmp_path / "rig.toml")
    for name in rig().names:
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.random.default_rng(0).integers(0, 255, (576, 768, 3), np.uint8))
    arguments = ["--images", str(tmp_path / "{view}.png"), "--picture", str(tmp_path / "lines.png")]
    result = CliRunner().invoke(app, ["rig", "check", str(tmp_path / "rig.toml"), *arguments])
    assert result.exit_code == 0, result.output
    assert "north_east" in result.output
    assert cv2.imread(str(tmp_path / "lines.png")) is not None
    files = str(tmp_path / "rig.toml"), str(tmp_path / "q.xml")
    result = CliRunner().invoke(app, ["rig", "convert", *files, "--layout", "qualisys"])
    assert result.exit_code == 0, result.output
    converted, original = import_rig(tmp_path / "q.xml"), load_rig(tmp_path / "rig.toml")
    np.testing.assert_allclose(converted.cameras[0].matrix, original.cameras[0].matrix)
