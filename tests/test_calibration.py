"""Calibration from images: boards, points, world frames, reports, and recordings that cannot be right."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from bars import at_truth, calibration, images_of, recorded
from benchmarks.bars import SIZE, Faults
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from tracker.cameras.calibration import report_text
from tracker.cameras.calibration._bundle import State
from tracker.cameras.calibration._self_calibration import time_offsets
from tracker.cameras.calibration._start import bar_observations
from tracker.cameras.calibration._world import WorldFrame, moved_rig
from tracker.cameras.calibration.chessboard import BoardImages, ChessboardCalibration
from tracker.cameras.calibration.reference_bar import BarImages
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import load_rig
from tracker.foundation.errors import CalibrationError, ConfigError, TrackerError
from tracker.foundation.geometry import rigid_motion
from tracker.foundation.progress import silent
from tracker.running.cli import app
from tracker.running.jobs import execute
from tracker.running.jobs.calibrate import load_calibration

# From scratch


@pytest.mark.parametrize("around", [True, False])
def test_from_scratch_with_focal_lengths_nobody_knows(around):
    recording = recorded(11, 100, Faults(0.1, 0.05, 0.05), around)
    result = calibration(focal_px=None).calibrate_images(images_of(recording))
    ours, theirs = (np.stack([c.centre for c in rig.cameras]) for rig in (result.rig, recording.rig))
    motion = rigid_motion(ours, theirs)
    np.testing.assert_allclose(ours @ motion[:3, :3].T + motion[:3, 3], theirs, atol=0.03)
    assert result.measures[0].value < 2.0  # mm, hold-out bars of 0.8 m
    assert 0.85 < result.adjustment.s0 < 1.15


def test_ends_named_differently_in_every_view_do_no_harm():
    recording = recorded(12, 80)
    images = images_of(recording)
    pixels = images.pixels.copy()
    pixels[[1, 3]] = pixels[[1, 3]][:, :, ::-1]
    turned = calibration().calibrate_images(BarImages(images.names, images.sizes, images.frames, pixels))
    plain = calibration().calibrate_images(images)
    for one, other in zip(turned.rig.cameras, plain.rig.cameras, strict=True):
        assert one.matrix[0, 0] == pytest.approx(other.matrix[0, 0], abs=0.5)
    assert not turned.adjustment.exchanged.any()


@pytest.mark.parametrize(("late", "name"), [((0, 1, 0, 0), "north_west"), ((-1, 0, 0, 0), "north_east")])
def test_a_view_out_of_step_is_named(late, name):
    recording = recorded(13, 150, Faults(0.1, 0.03, 0.03, late_frames=late, stride=1))
    with pytest.raises(CalibrationError) as caught:
        calibration().calibrate_images(images_of(recording))
    word = "late" if sum(late) > 0 else "early"
    assert re.search(rf'"{name}" is (0.9|1.0) frames {word}', str(caught.value))
    assert f"{name} = {-sum(late)}" in str(caught.value)


@pytest.mark.parametrize("n_views", [2, 4])
def test_time_offsets_are_as_uncertain_of_the_first_view_as_of_the_others(n_views):
    recording = recorded(2, 60, Faults(1.0, 0, 0, stride=1))
    state, _ = at_truth(recording)
    few = State(state.cameras[:n_views], state.objects)
    images = bar_observations(recording.pixels[:n_views], images_of(recording).velocities()[:n_views])
    _, sigmas = time_offsets(few, images, 0.1)
    assert (sigmas > 0.003).all()
    assert sigmas.max() < 2 * sigmas.min()


def test_a_third_of_a_frame_is_measured_and_allowed_for():
    recording = recorded(13, 200, Faults(0.1, 0.03, 0.03, late_frames=(0, 0, 0.3, 0), stride=1))
    result = calibration().calibrate_images(images_of(recording))
    lag = {measure.name: measure.value for measure in result.measures}["time offset of south_west"]
    assert lag == pytest.approx(0.3, abs=0.03)
    assert any("south_west exposes 0.3" in sentence for sentence in result.advice)
    assert result.measures[0].value < 0.8  # mm, hold-out bars; 0.53 in step, 1.6 with the lag left in their images


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda p: p[:1], "north_east alone, expected at least two views"),
        (lambda p: p[:, :6], "common bar positions"),
        (lambda p: np.full_like(p, np.nan), "common bar positions"),
        (lambda p: np.random.default_rng(0).uniform(0, 500, p.shape), "camera|views|bars"),
    ],
)
def test_recordings_that_tell_nothing_are_refused(change, words):
    images = images_of(recorded(14, 60))
    pixels = change(images.pixels)
    n, n_bars = pixels.shape[:2]
    few = BarImages(images.names[:n], images.sizes[:n], images.frames[:n_bars], pixels)
    with pytest.raises(CalibrationError, match=words) as caught:
        calibration().calibrate_images(few)
    assert "\n" not in str(caught.value)


def test_a_bar_of_unknown_length_is_refused():
    with pytest.raises(CalibrationError, match=r"length of the bar is not given.*length_m"):
        calibration(length_m=None).calibrate_images(images_of(recorded(15, 40)))


def test_a_world_from_two_bars_on_the_floor():
    recording = recorded(16, 100)
    result = calibration(world=WorldFrame()).calibrate_images(images_of(recording))
    ends = np.full((100, 2, 3), np.nan)
    ends[:2] = [[(0, 0, 0), (0.8, 0, 0)], [(0.1, 0.2, 0), (0.1, 1.0, 0)]]
    turn = np.eye(4)
    turn[:3, :3], turn[:3, 3] = Rotation.from_rotvec((0.4, -1.0, 2.0)).as_matrix(), (1, 2, 3)
    inside = ends @ turn[:3, :3].T + turn[:3, 3]
    frame = WorldFrame(x_bar_frame=0, y_bar_frame=1)
    rig, motion, _ = frame.placed(result.rig, (np.arange(100), inside), np.zeros(3))
    np.testing.assert_allclose(motion, np.linalg.inv(turn), atol=1e-9)
    np.testing.assert_allclose(
        rig.project(ends[:2].reshape(-1, 3)), result.rig.project(inside[:2].reshape(-1, 3)), atol=1e-6
    )


def written_points(path: Path, rig: Rig, points: np.ndarray, noise: float = 0.0) -> Path:
    rng = np.random.default_rng(0)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["x", "y", "z", *(f"{name}_{axis}" for name in rig.names for axis in "uv")])
        images = rig.project(points) + rng.normal(0, noise, (len(rig), len(points), 2))
        for k, point in enumerate(points):
            writer.writerow([*point, *np.round(images[:, k].ravel(), 4)])
    return path


def test_a_world_from_given_points(tmp_path):
    rig = recorded(17, 4).rig
    points = np.random.default_rng(0).uniform((-1, -1, 0), (1, 1, 2), (6, 3))
    path = written_points(tmp_path / "points.csv", rig, points)
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_rotvec((0.4, -1.0, 2.0)).as_matrix()
    placed, _, _ = WorldFrame(points=path).placed(moved_rig(rig, turn), None, np.zeros(3))
    np.testing.assert_allclose(placed.project(points), rig.project(points), atol=1e-3)


# Whole runs


VIDEO = '[reading]\nuse = "video"\npath = "{view}.mp4"\nviews = ["a", "b"]\n'


def a_run(tmp_path: Path, rig: Rig, calibration_table: str) -> Path:
    """Blank pictures of every view and a configuration."""
    for name in rig.names:
        (tmp_path / name).mkdir(exist_ok=True)
        for k in range(3):
            cv2.imwrite(str(tmp_path / name / f"{k}.png"), np.full((SIZE[1], SIZE[0]), 90, np.uint8))
    names = ", ".join(f'"{name}"' for name in rig.names)
    config = tmp_path / "run.toml"
    config.write_text(
        f'[reading]\nuse = "images"\nfps = 25.0\npath = "{{view}}/{{frame}}.png"\nviews = [{names}]\n'
        f"[calibration]\n{calibration_table}"
    )
    return config


def test_points_calibrate_a_rig_and_the_report_is_written(tmp_path):
    rig = recorded(18, 4).rig
    points = np.random.default_rng(0).uniform((-1.3, -1.3, 0), (1.3, 1.3, 2), (60, 3))
    written_points(tmp_path / "points.csv", rig, points, 0.2)
    config = a_run(tmp_path, rig, 'points = "points.csv"\nfocal_px = 850.0\nsigma_px = 0.2\nsigma_m = 0.0005')
    output = tmp_path / "out"
    result = CliRunner().invoke(app, ["calibrate", "points", str(config), "--output", str(output)])
    assert result.exit_code == 0, result.output
    assert "what to do better" in result.output
    assert sorted(p.name for p in output.iterdir()) == [
        "config.toml",
        "log.txt",
        "report.html",
        "report.txt",
        "residuals.csv",
        "rig.toml",
    ]
    found = load_rig(output / "rig.toml")
    for one, other in zip(found.cameras, rig.cameras, strict=True):
        np.testing.assert_allclose(one.centre, other.centre, atol=0.03)
    page = (output / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 2 + len(rig)
    assert not list(tmp_path.glob(".unfinished*"))


@pytest.mark.parametrize(
    ("kind", "table", "words"),
    [
        ("reference_bar", "length_m = 1.0", "no disc target"),
        ("reference_bar", "", "length of the bar is not given"),
        ("chessboard", "square_m = 0.03", "blank or blurred"),
        ("chessboard", 'square_m = 0.03\nmarker_m = 0.02\ndictionary = "4x4_51"', "4x4_50"),
        ("scene_points", 'points = "points.csv"\nfocal_px = 800.0', "points.csv"),
    ],
)
def test_blank_images_leave_nothing_half_written(tmp_path, kind, table, words):
    config = a_run(tmp_path, recorded(19, 4).rig, table)
    before = set(tmp_path.iterdir())
    with pytest.raises(TrackerError, match=words) as caught:
        execute(load_calibration(config, kind), tmp_path / "out")
    assert "\n" not in str(caught.value)
    assert set(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (VIDEO, 'the key "calibration" is missing, expected e.g. calibration = '),
        (VIDEO + "[views]\n", 'unknown section "views"; valid: calibration, interiors, name, reading'),
        (VIDEO + '[calibration]\nuse = "chessboard"\n', 'use = "chessboard"'),
        (VIDEO + "[calibration]\nlenght_m = 1.0\n", "length_m"),
        (VIDEO + 'rig = "x.toml"\n[calibration]\n', 'the key "rig" is of no use'),
    ],
)
def test_wrong_configurations_are_named(tmp_path, text, words):
    (tmp_path / "run.toml").write_text(text)
    with pytest.raises(ConfigError, match=words):
        load_calibration(tmp_path / "run.toml", "reference_bar")


# Real recordings


def test_the_rendered_bar_recording(data):
    """Rig recovered from video: targets, labels, start values, adjustment."""
    folder = data("room/bar")
    config = Path(__file__).parents[1] / "configs" / "calibration" / "bar.toml"
    run = load_calibration(config, "reference_bar", ["reading.stride=2"])
    result = run.calibration.calibrate(run.open(), silent)
    rows = np.genfromtxt(folder / "gt_targets.csv", delimiter=",", names=True)
    images = np.stack([np.column_stack([rows[f"{name}_u"], rows[f"{name}_v"]]) for name in result.rig.names])
    truth = np.column_stack([rows["x"], rows["y"], rows["z"]])
    points, _ = result.rig.triangulate(images)
    motion = rigid_motion(points, truth)
    errors = points @ motion[:3, :3].T + motion[:3, 3] - truth
    assert 1000 * np.sqrt(np.mean(np.sum(errors**2, axis=1))) < 5.0  # mm, in a room of 7 m
    lengths = np.linalg.norm(points[::2] - points[1::2], axis=1)
    assert np.mean(lengths) == pytest.approx(1.0, abs=0.003)


def test_four_real_cameras_and_a_board(data):
    with (data("calib4") / "corners.csv").open() as file:
        rows = list(csv.DictReader(file))
    cameras = sorted({row["cam_id"] for row in rows})
    seen: dict[tuple[int, int], list[dict[str, str]]] = {}
    for row in rows:
        seen.setdefault((cameras.index(row["cam_id"]), int(row["sync_index"])), []).append(row)
    corners = {
        key: (
            np.array([[float(row["obj_loc_x"]), float(row["obj_loc_y"]), 0.0] for row in found]),
            np.array([[float(row["img_loc_x"]), float(row["img_loc_y"])] for row in found]),
        )
        for key, found in seen.items()
        if len(found) >= 6
    }
    images = BoardImages(tuple(cameras), ((1280, 720),) * 4, corners)
    result = ChessboardCalibration(square_m=0.054, sigma_px=0.3).calibrate_images(images)
    adjustment = result.adjustment
    for v in range(4):
        errors = np.linalg.norm(adjustment.errors[adjustment.observations.views == v], axis=1)
        assert np.nanmedian(errors) < 0.6  # the authors': 0.35 to 0.65 px
    measures = {measure.name: measure.value for measure in result.measures}
    assert abs(measures["board distances, median"]) < 0.3  # per cent, the authors'
    assert measures["board distances, quartiles"] < 0.8
    assert "board distances" in report_text("calib4", result)


def test_four_real_videos_of_a_board_with_two_sides(data):
    data("calib4/cam_0.mp4")
    config = Path(__file__).parents[1] / "configs" / "calibration" / "charuco.toml"
    run = load_calibration(config, "chessboard", ["reading.stride=2"])
    result = run.calibration.calibrate(run.open(), silent)
    measures = {measure.name: measure.value for measure in result.measures}
    assert abs(measures["board distances, median"]) < 0.3  # per cent
    assert max(result.adjustment.rms_px(v) for v in range(4)) < 0.65


def test_stereo_pairs_of_a_chessboard(data):
    data("stereo_gt/opencv_chessboard")
    config = Path(__file__).parents[1] / "configs" / "calibration" / "chessboard.toml"
    run = load_calibration(config, "chessboard")
    result = run.calibration.calibrate(run.open(), silent)
    for v in range(2):
        assert result.adjustment.rms_px(v) * np.sqrt(2) < 0.23  # cv2.stereoCalibrate: 0.22 px, of the distance
    baseline = np.linalg.norm(result.rig.cameras[0].centre - result.rig.cameras[1].centre) / 0.025
    assert baseline == pytest.approx(3.33, abs=0.03)
