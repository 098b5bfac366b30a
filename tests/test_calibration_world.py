"""One world in the report and in the file, and lengths that are no metres: told before anything is written."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bars import calibration, images_of, recorded
from test_fisheye_calibration import boards_seen, three_cameras

from tracker.cameras.calibration import Calibrated, report_text
from tracker.cameras.calibration._adjustment import Adjustment
from tracker.cameras.calibration._bundle import residuals
from tracker.cameras.calibration.chessboard import ChessboardCalibration
from tracker.cameras.rig_check import check_rig
from tracker.cameras.rig_layouts import load_rig, read_rig, save_rig
from tracker.foundation.errors import CalibrationError, ConfigError
from tracker.running.jobs.calibrate import load_calibration, looked_over


def a_bar() -> Calibrated:
    return calibration().calibrate_images(images_of(recorded(13, 60)))


def a_board() -> Calibrated:
    fisheye = ChessboardCalibration(columns=9, rows=6, square_m=0.06, lens="fisheye")
    return fisheye.calibrate_images(boards_seen(three_cameras(), n=12))


@pytest.mark.parametrize("made", [a_bar, a_board])
def test_the_report_has_the_cameras_where_the_file_has_them(made, tmp_path):
    found = made()
    save_rig(found.rig, tmp_path / "rig.toml")
    told = re.findall(r"centre [xyz]  (-?[\d.]+) m", report_text("x", found))
    centres = np.array(told, dtype=np.float64).reshape(-1, 3)
    np.testing.assert_allclose(centres, [one.centre for one in load_rig(tmp_path / "rig.toml").cameras], atol=1e-4)
    adjustment = found.adjustment
    errors = residuals(adjustment.state, adjustment.observations)[adjustment.used]
    np.testing.assert_allclose(errors, adjustment.errors[adjustment.used], atol=1e-6)
    np.testing.assert_allclose(found.points, adjustment.state.objects.points, atol=1e-9)


def test_standard_errors_lie_along_the_axes_of_the_world():
    """A quarter turn about z: what was along x is along y, and turns about the cameras' own axes stay."""
    before = a_bar().adjustment
    quarter = np.array([[0.0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    after = before.in_world(quarter)
    assert isinstance(after, Adjustment)
    np.testing.assert_allclose(after.sigmas[:, 3:6], before.sigmas[:, [4, 3, 5]], rtol=1e-9)
    np.testing.assert_allclose(np.delete(after.sigmas, [3, 4], axis=1), np.delete(before.sigmas, [3, 4], axis=1))
    for one, other in zip(before.cameras, after.cameras, strict=True):
        np.testing.assert_allclose(other.centre, quarter[:3, :3] @ one.centre + (1, 2, 3), atol=1e-12)


def larger(found: Calibrated, factor: float) -> Calibrated:
    state = found.adjustment.state
    cameras = state.cameras.copy()
    cameras[:, 9:12] *= factor
    return replace(found, adjustment=replace(found.adjustment, state=replace(state, cameras=cameras)))


def test_a_rig_that_no_reader_takes_is_not_written(tmp_path):
    found = a_bar()
    wide = larger(found, 1000)
    with pytest.raises(CalibrationError, match=r"come out \d{4} m apart.*length_m = 0\.8.*in metres\?"):
        looked_over(wide)
    save_rig(wide.rig, tmp_path / "wide.toml")
    with pytest.raises(CalibrationError, match="m apart, expected a room"):
        read_rig(tmp_path / "wide.toml")
    near = looked_over(larger(found, 0.005))
    assert "are the units metres?" in near.advice[0]
    assert set(check_rig(near.rig).doubts) < set(near.advice)


@pytest.mark.parametrize(
    ("kind", "table", "words"),
    [
        ("chessboard", "square_m = 54", r"square_m.*54 m long.*0\.054 if 54 mm are meant"),
        ("chessboard", "square_m = 54.0", r"0\.054 if 54 mm are meant"),
        ("chessboard", "square_m = 5.4", r"0\.054 if 5\.4 cm are meant"),
        ("chessboard", "square_m = 2.0", r"0\.0508 if 2 inches are meant"),
        ("chessboard", "square_m = 0.054\nmarker_m = 40.5", r"0\.0405 if 40\.5 mm are meant"),
        ("chessboard", "square_m = 0.054\nworld.board_square_m = 30.0", r"0\.03 if 30 mm are meant"),
        ("reference_bar", "length_m = 1000.0", "1 if 1000 mm are meant"),
    ],
)
def test_lengths_that_are_no_metres_are_told_at_the_configuration(kind, table, words, tmp_path: Path):
    path = tmp_path / "run.toml"
    path.write_text(f'[reading]\nuse = "video"\npath = "{{view}}.mp4"\nviews = ["a", "b"]\n[calibration]\n{table}\n')
    with pytest.raises(ConfigError, match=words):
        load_calibration(path, kind)


def test_a_focal_length_in_millimetres_is_told():
    with pytest.raises(CalibrationError, match=r"focal_px = 8 .*at least 115 for 768x576 px.*sensor's width in mm"):
        calibration(focal_px=8.0).calibrate_images(images_of(recorded(13, 8)))
