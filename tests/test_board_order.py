"""Boards that look the same when they are turned or mirrored, that never tilt, and views that see different ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from board_prints import chessboard, filmed, shown_about, two_cameras
from scipy.spatial.transform import Rotation

from tracker.cameras.calibration import Calibrated
from tracker.cameras.calibration._boards import find_corners, turns_of
from tracker.cameras.calibration.chessboard import BoardImages, ChessboardCalibration
from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array
from tracker.foundation.errors import CalibrationError

SIZE, SQUARE_M, NOISE_PX = (640, 480), 0.03, 0.1
MIDDLE = np.array([0.0, 1.0, 1.0])


def cameras() -> list[Camera]:
    places = {"left": (-0.3, 0.0, 1.0), "right": (0.3, 0.0, 1.0), "far": (0.9, 0.2, 1.2)}
    return [Camera.looking_at(name, SIZE, 600.0, at, (0.0, 1.0, 1.0)) for name, at in places.items()]


def boards(
    columns: int, rows: int, n: int = 16, tilt: float = 0.5, moved: float = 0.1, n_views: int = 3
) -> BoardImages:
    """Corners of a board that is moved before cameras, in the order of its plan."""
    rng = np.random.default_rng(2)
    across, down = np.meshgrid(np.arange(columns), np.arange(rows))
    plan = SQUARE_M * np.column_stack([across.ravel(), down.ravel(), np.zeros(columns * rows)])
    upright = Rotation.from_rotvec([-np.pi / 2, 0, 0])
    seen = {}
    for frame in range(n):
        turn = upright * Rotation.from_rotvec([*rng.uniform(-tilt, tilt, 2), rng.uniform(-tilt, tilt)])
        space = turn.apply(plan - plan.mean(axis=0)) + MIDDLE + rng.uniform(-moved, moved, 3)
        for v, camera in enumerate(cameras()[:n_views]):
            seen[v, frame] = plan, camera.project(space) + rng.normal(0, NOISE_PX, (len(plan), 2))
    return BoardImages(tuple(camera.name for camera in cameras()[:n_views]), (SIZE,) * n_views, seen)


def calibrated(images: BoardImages, columns: int, rows: int) -> Calibrated:
    groups = ("camera_constant", "principal_point")
    return ChessboardCalibration(
        columns=columns, rows=rows, square_m=SQUARE_M, sigma_px=NOISE_PX, estimated=groups
    ).calibrate_images(images)


def distances(rig_cameras: list[Camera]) -> Array:
    centres = np.array([camera.centre for camera in rig_cameras])
    return np.linalg.norm(centres[:, None] - centres, axis=2)


def some_turned(images: BoardImages, columns: int, rows: int) -> BoardImages:
    """The same, each view with the ends of the board as chance has it."""
    turns, rng = turns_of(columns, rows, SQUARE_M), np.random.default_rng(0)
    seen = {}
    for key, (shape, pixels) in images.seen.items():
        turn = turns[rng.integers(len(turns))]
        seen[key] = shape @ turn[:3, :3].T + turn[:3, 3], pixels
    return replace(images, seen=seen)


@pytest.mark.parametrize(("columns", "rows", "n_turns"), [(8, 6, 2), (9, 7, 2), (6, 6, 4), (7, 7, 4)])
def test_boards_that_look_the_same_from_both_ends_calibrate(columns: int, rows: int, n_turns: int) -> None:
    assert len(turns_of(columns, rows, SQUARE_M)) == n_turns
    images = some_turned(boards(columns, rows), columns, rows)
    found = calibrated(images, columns, rows)
    assert 0.8 < found.adjustment.s0 < 1.2
    assert found.adjustment.used.mean() > 0.99
    np.testing.assert_allclose(distances(list(found.rig.cameras)), distances(cameras()), atol=0.005)


def test_of_one_frame_nobody_can_tell_which_end_is_which() -> None:
    images = boards(8, 6, n_views=2)
    alone = {key: one for key, one in images.seen.items() if key[0] == 0 or key[1] == 0}
    alone |= {(1, frame + 100): images.seen[1, frame] for frame in range(1, 6)}
    with pytest.raises(CalibrationError, match=r'"left" and "right": the board looks the same when it is turned'):
        calibrated(replace(images, seen=alone), 8, 6)
    assert calibrated(boards(9, 6, n=5, n_views=2), 9, 6).n_objects == 5


def test_a_board_with_one_end_has_one_turn() -> None:
    assert len(turns_of(9, 6, SQUARE_M)) == 1


@pytest.mark.parametrize(("columns", "rows"), [(9, 6), (8, 6), (6, 9)])
def test_a_view_that_is_mirrored_is_named(columns: int, rows: int) -> None:
    """A chessboard looks the same in a mirror: its corners are found, from the side where the colours are the same."""
    images = boards(columns, rows)
    axis = 1 if rows % 2 == 0 else 0
    seen = dict(images.seen)
    for frame in range(16):
        shape, pixels = seen[1, frame]
        other = shape.copy()
        other[:, axis] = shape[:, axis].max() - shape[:, axis]
        seen[1, frame] = other, np.column_stack([SIZE[0] - 1 - pixels[:, 0], pixels[:, 1]])
    with pytest.raises(CalibrationError, match=r'^"right": the pictures of this view are mirrored'):
        calibrated(replace(images, seen=seen), columns, rows)
    two = {key: one for key, one in seen.items() if key[0] < 2}
    with pytest.raises(CalibrationError, match=r'^"left" or "right": the pictures of one of these views are mirrored'):
        calibrated(BoardImages(images.names[:2], images.sizes[:2], two), columns, rows)


def test_views_that_see_different_boards_are_told() -> None:
    images = boards(9, 6)
    seen = {(v, (frame * 5) % 16 if v == 1 else frame): one for (v, frame), one in images.seen.items()}
    with pytest.raises(CalibrationError, match=r'"left" and "right" do not see one and the same board.*in step'):
        calibrated(replace(images, seen=seen), 9, 6)


def facing(n_views: int) -> BoardImages:
    """A board that is level with the first camera, and seen aslant by the others."""
    rng = np.random.default_rng(4)
    images = boards(9, 6, n_views=n_views)
    plan = images.seen[0, 0][0]
    level = Rotation.from_matrix(cameras()[0].camera_from_world[:3, :3].T)
    seen = {}
    for frame in range(20):
        turned = (level * Rotation.from_rotvec([0, 0, rng.uniform(-0.3, 0.3)])).apply(plan - plan.mean(axis=0))
        space = turned + MIDDLE + rng.uniform(-0.1, 0.1, 3) * (1, 5, 1)
        for v, camera in enumerate(cameras()[:n_views]):
            seen[v, frame] = plan, camera.project(space) + rng.normal(0, NOISE_PX, (len(plan), 2))
    return replace(images, seen=seen)


def test_a_board_that_is_never_tilted_tells_no_focal_length() -> None:
    with pytest.raises(CalibrationError, match=r"^left: the board is tilted too little.*20 to 45 degrees"):
        calibrated(facing(1), 9, 6)
    with pytest.raises(CalibrationError, match=r"^left: the positions of the board leave the focal length.* open"):
        calibrated(boards(9, 6, tilt=0.0, n_views=1), 9, 6)
    found = calibrated(boards(9, 6, tilt=0.3, n_views=1), 9, 6)
    assert found.rig.cameras[0].matrix[1, 1] == pytest.approx(600, rel=0.03)


def test_a_view_before_which_it_is_not_tilted_begins_with_the_focal_length_of_the_others() -> None:
    for camera in calibrated(facing(2), 9, 6).rig.cameras:
        assert camera.matrix[1, 1] == pytest.approx(600, rel=0.01)


def test_a_filmed_board_with_two_like_ends_calibrates() -> None:
    """Turned about in the plane, so that OpenCV begins now at this end, now at that one."""
    board = chessboard(6, 4)
    seen = {}
    for frame, pose in enumerate(shown_about(board, 12, roll=3.0)):
        for v, camera in enumerate(two_cameras()):
            corners = find_corners(filmed(board, camera, pose), (6, 4))
            assert corners is not None
            across, down = np.meshgrid(np.arange(6), np.arange(4))
            plan = 0.05 * np.column_stack([across.ravel(), down.ravel(), np.zeros(24)])
            seen[v, frame] = plan, corners
    images = BoardImages(("left", "right"), ((480, 360),) * 2, seen)
    found = ChessboardCalibration(columns=6, rows=4, square_m=0.05, estimated=("camera_constant",))
    rig = found.calibrate_images(images).rig
    np.testing.assert_allclose(distances(list(rig.cameras)), distances(two_cameras()), rtol=0.02)
