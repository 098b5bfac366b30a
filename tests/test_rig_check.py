"""The looks that a rig check takes, and the commands."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from bars import recorded
from typer.testing import CliRunner

from tracker.cameras.rig import Rig
from tracker.cameras.rig_check import check_points, check_rig, epipolar_picture
from tracker.cameras.rig_layouts import load_rig, save_rig
from tracker.foundation.errors import CalibrationError
from tracker.running.cli import app


def rig() -> Rig:
    return recorded(0, 4).rig


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
    converted, original = load_rig(tmp_path / "q.xml"), load_rig(tmp_path / "rig.toml")
    np.testing.assert_allclose(converted.cameras[0].matrix, original.cameras[0].matrix)
