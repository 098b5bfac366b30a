"""Calibration from images: targets, boards, points, world frames, reports, and recordings that cannot be right."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from bars import calibration, images_of, recorded
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from tracker.calibration import report_text
from tracker.calibration._bar_images import follow
from tracker.calibration._spheres import measure_sphere
from tracker.calibration._targets import Target, measure_target
from tracker.calibration._world import WorldFrame, moved_rig, rigid_alignment
from tracker.calibration.chessboard import BoardImages, ChessboardCalibration
from tracker.calibration.reference_bar import BarImages
from tracker.camera import Camera
from tracker.cli import app
from tracker.errors import CalibrationError, ConfigError, TrackerError
from tracker.jobs import execute
from tracker.jobs.calibrate import load_calibration
from tracker.progress import silent
from tracker.rig import Rig
from tracker.rig_layouts import load_rig
from tracker.simulation.bars import SIZE, Faults


def disc(rng: np.random.Generator, centre, radius: float, n: int = 49, noise: float = 1.0) -> np.ndarray:
    """A blurred, noisy picture of a tilted disc, exact to an eighth of a pixel."""
    fine = (np.arange(8 * n) + 0.5) / 8 - 0.5
    x, y = np.meshgrid(fine - centre[0], fine - centre[1])
    angle, flat = rng.uniform(0, np.pi), radius * rng.uniform(0.7, 1.0)
    u, v = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    cover = ((u / radius) ** 2 + (v / flat) ** 2 < 1).astype(float).reshape(n, 8, n, 8).mean(axis=(1, 3))
    blurred = cv2.GaussianBlur(cover, (0, 0), 0.7)
    return np.clip(np.round(60 + 150 * blurred + rng.normal(0, noise, blurred.shape)), 0, 255)


@pytest.mark.parametrize("radius", [3.5, 5.0, 8.0])
def test_discs_are_measured_to_a_hundredth_of_a_pixel(radius):
    rng, errors = np.random.default_rng(0), []
    for _ in range(40):
        centre = 24 + rng.uniform(-0.5, 0.5, 2)
        target = measure_target(disc(rng, centre, radius), (24.0, 24.0), radius)
        assert target is not None
        assert target.axes[0] == pytest.approx(radius, abs=0.3)
        errors.append(np.array(target.centre) - centre)
    assert np.sqrt(np.mean(np.square(errors))) < 0.010


def test_a_bar_before_a_disc_is_no_part_of_its_ellipse():
    rng = np.random.default_rng(1)
    picture = disc(rng, (24.3, 23.8), 7.0)
    picture[22:26, 30:] = 20.0
    target = measure_target(picture, (24.0, 24.0), 7.0)
    assert target is not None
    np.testing.assert_allclose(target.centre, (24.3, 23.8), atol=0.15)


def test_a_ball_lit_from_above_is_not_drawn_to_the_light():
    n, centre, radius = 45, np.array([22.3, 21.6]), 6.0
    x, y = np.meshgrid(np.arange(n) - centre[0], np.arange(n) - centre[1])
    distance = np.hypot(x, y) / radius
    cover = np.clip(0.5 + radius * (1 - distance), 0, 1)
    rng = np.random.default_rng(0)
    behind = 130 + rng.normal(0, 1, (n, n))
    shade = 170 - 60 * y / radius + 20 * np.sqrt(np.clip(1 - distance**2, 0, 1))
    picture = behind * (1 - cover) + shade * cover + rng.normal(0, 1, (n, n))
    target = measure_sphere(picture, behind, (22.0, 20.0), 5.0, 25.0)
    assert target is not None
    np.testing.assert_allclose(target.centre, centre, atol=0.05)


def test_nothing_is_measured_where_nothing_is():
    blank = np.random.default_rng(0).normal(100, 2, (49, 49))
    assert measure_target(blank, (24.0, 24.0), 5.0) is None
    assert measure_sphere(blank, blank, (24.0, 24.0), 5.0, 25.0) is None


def spot(x: float, y: float) -> Target:
    return Target((x, y), (5.0, 5.0), 100.0, 0.1)


def test_targets_that_pass_each_other_keep_their_names():
    times = np.arange(30)
    ways = np.stack(
        [np.column_stack([10.0 * times, 100 + 3.0 * times]), np.column_stack([300 - 10.0 * times, 190 - 3.0 * times])]
    )
    rng = np.random.default_rng(0)
    frames = [[spot(*ways[e, t]) for e in rng.permutation(2)] for t in times]
    found = follow(frames)
    first = 0 if np.allclose(found[0, 0], ways[0, 0]) else 1
    np.testing.assert_allclose(found[:, 0], ways[first])
    np.testing.assert_allclose(found[:, 1], ways[1 - first])


def test_a_view_that_lacks_frames_goes_on():
    frames = [[spot(5.0 * t, 50.0), spot(200.0, 50.0 + t)] if t not in (6, 7, 12) else [] for t in range(20)]
    found = follow(frames)
    assert np.isnan(found[[6, 7, 12]]).all()
    seen = [t for t in range(20) if t not in (6, 7, 12)]
    np.testing.assert_allclose(sorted(found[seen, :, 0].max(axis=1)), [200.0] * len(seen))


# From scratch


@pytest.mark.parametrize("around", [True, False])
def test_from_scratch_with_focal_lengths_nobody_knows(around):
    recording = recorded(11, 100, Faults(0.1, 0.05, 0.05), around)
    result = calibration(focal_px=None).calibrate_images(images_of(recording))
    ours, theirs = (np.stack([c.centre for c in rig.cameras]) for rig in (result.rig, recording.rig))
    motion = rigid_alignment(ours, theirs)
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


def test_a_third_of_a_frame_is_measured_and_allowed_for():
    recording = recorded(13, 200, Faults(0.1, 0.03, 0.03, late_frames=(0, 0, 0.3, 0), stride=1))
    result = calibration().calibrate_images(images_of(recording))
    lag = {measure.name: measure.value for measure in result.measures}["time offset of south_west"]
    assert lag == pytest.approx(0.3, abs=0.03)
    assert any("south_west exposes 0.3" in sentence for sentence in result.advice)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda p: p[:, :6], "common bar positions"),
        (lambda p: np.full_like(p, np.nan), "common bar positions"),
        (lambda p: np.random.default_rng(0).uniform(0, 500, p.shape), "camera|views|bars"),
    ],
)
def test_recordings_that_tell_nothing_are_refused(change, words):
    images = images_of(recorded(14, 60))
    pixels = change(images.pixels)
    few = BarImages(images.names, images.sizes, images.frames[: pixels.shape[1]], pixels)
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


# Cameras that saw the board one at a time

PRINT = np.kron(np.indices((8, 11)).sum(axis=0) % 2, np.ones((40, 40))).astype(np.uint8)[:, :] * 255


def picture_of_board(camera, world_from_board, square_m=0.03):
    """A chessboard of 10 x 7 inner corners with a white rim, as a camera sees it."""
    plan = np.array([[-1, -1], [10, -1], [10, 7], [-1, 7]], dtype=np.float64) * square_m
    space = np.column_stack([plan, np.zeros(4)]) @ world_from_board[:3, :3].T + world_from_board[:3, 3]
    corners = np.array([[0, 0], [440, 0], [440, 320], [0, 320]], dtype=np.float64) + 79.5
    print_ = cv2.copyMakeBorder(PRINT, 80, 80, 80, 80, cv2.BORDER_CONSTANT, value=255)
    matrix = cv2.getPerspectiveTransform(corners.astype(np.float32), camera.project(space).astype(np.float32))
    size = camera.size[0], camera.size[1]
    fine = cv2.warpPerspective(print_, np.diag([3.0, 3, 1]) @ matrix, (3 * size[0], 3 * size[1]), borderValue=120)
    return cv2.resize(fine, size, interpolation=cv2.INTER_AREA)


def write_boards(folder, camera, rng, n, away, poses=None):
    """Pictures of a board that is held before a camera, or in given poses."""
    folder.mkdir(parents=True)
    for k in range(n):
        pose = np.eye(4) if poses is None else poses[k]
        if poses is None:
            turn = Rotation.from_rotvec([*rng.uniform(-0.5, 0.5, 2), rng.uniform(-0.2, 0.2)]).as_matrix()
            pose[:3, :3], middle = turn, turn @ (0.135, 0.09, 0)
            pose[:3, 3] = np.array([*rng.uniform(-0.12, 0.12, 2) * away, away]) - middle
            pose = np.linalg.inv(camera.camera_from_world) @ pose
        cv2.imwrite(str(folder / f"{k}.png"), picture_of_board(camera, pose))


INTERIORS = """[reading]
use = "images"
fps = 1.0
path = "common/{view}/{frame}.png"
views = ["left", "right"]
[calibration]
use = "chessboard"
columns = 10
rows = 7
square_m = 0.03
estimated = ["camera_constant", "principal_point"]
"""


def board_files(folder):
    """Two cameras that see a board alone, near, and together, small and far away."""
    rng = np.random.default_rng(0)
    cameras = [
        Camera.looking_at("left", (640, 480), 650.0, (0.0, 0.0, 0.0), (0.3, 2.0, 0.0)),
        Camera.looking_at("right", (640, 480), 610.0, (1.0, 0.0, 0.0), (0.7, 2.0, 0.0)),
    ]
    together = []
    for _ in range(4):
        turn = Rotation.from_rotvec([-np.pi / 2, 0, 0]) * Rotation.from_rotvec(rng.uniform(-0.4, 0.4, 3))
        pose = np.eye(4)
        pose[:3, :3] = turn.as_matrix()
        pose[:3, 3] = (0.5, 1.1, 0.0) - pose[:3, :3] @ (0.135, 0.09, 0)
        together.append(pose)
    for camera, n_alone in zip(cameras, (9, 7), strict=True):
        write_boards(folder / "alone" / camera.name, camera, rng, n_alone, 0.5)
        write_boards(folder / "common" / camera.name, camera, rng, 4, 0.0, together)
    (folder / "run.toml").write_text(
        INTERIORS + '[interiors]\nuse = "images"\nfps = 1.0\npath = "alone/{view}/{frame}.png"\n'
    )
    return cameras


def test_interiors_come_of_what_each_camera_saw_alone_and_places_of_what_they_saw_together(tmp_path):
    cameras = board_files(tmp_path)
    job = load_calibration(tmp_path / "run.toml", "chessboard")
    result = job.calibration.calibrate(job.open(), silent)
    assert result.n_objects == 9 + 7 + 4
    for v, camera in enumerate(cameras):
        found, sigma = result.adjustment.state.cameras[v, 12], result.adjustment.sigmas[v, 6]
        assert sigma < 0.005 * camera.matrix[1, 1]
        assert abs(found - camera.matrix[1, 1]) < 4 * sigma
    baseline = np.linalg.norm(result.rig.cameras[0].centre - result.rig.cameras[1].centre)
    assert baseline == pytest.approx(1.0, abs=0.02)
    (tmp_path / "run.toml").write_text(INTERIORS)
    job = load_calibration(tmp_path / "run.toml", "chessboard")
    together = job.calibration.calibrate(job.open(), silent)  # four small boards, far away
    assert together.adjustment.sigmas[0, 6] > 3 * result.adjustment.sigmas[0, 6]


def test_interiors_that_cannot_be_are_named(tmp_path):
    board_files(tmp_path)
    path = tmp_path / "run.toml"
    with pytest.raises(ConfigError, match='views: "lefd"; did you mean "left"'):
        load_calibration(path, "chessboard", ['interiors.views=["lefd"]']).open()
    with pytest.raises(
        CalibrationError, match='camera "left": its own recording has 320x240 px, the common one 640x480'
    ):
        load_calibration(path, "chessboard", ["interiors.downscale=2"]).open()
    path.write_text(path.read_text().replace('"chessboard"', '"reference_bar"'))
    with pytest.raises(ConfigError, match='"interiors" is of use with a chessboard only'):
        load_calibration(path, "reference_bar", ["calibration={use='reference_bar', length_m=1.0}"])


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
    motion = rigid_alignment(points, truth)
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
    run = load_calibration(Path(__file__).parents[1] / "configs" / "calibration" / "charuco.toml", "chessboard")
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
