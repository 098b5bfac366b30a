"""Cameras that saw the board one at a time."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tracker.cameras.camera import Camera
from tracker.foundation.errors import CalibrationError, ConfigError
from tracker.foundation.progress import silent
from tracker.running.jobs.calibrate import load_calibration

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
