"""A world from a board on the floor, seen from two sides."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tracker.cameras.calibration._world import WorldFrame
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Image
from tracker.foundation.errors import CalibrationError

SQUARE_M, SQUARE_PX = 0.1, 60


def board_in(camera: Camera, columns: int, rows: int) -> Image:
    """A picture of a board on the floor, its first inner corner at the origin, with a white border."""
    board = np.full(((rows + 3) * SQUARE_PX, (columns + 3) * SQUARE_PX), 255, np.uint8)
    for row, column in np.ndindex(rows + 1, columns + 1):
        if (row + column) % 2 == 0:
            board[SQUARE_PX * (row + 1) :, SQUARE_PX * (column + 1) :][:SQUARE_PX, :SQUARE_PX] = 0
    height, width = board.shape
    corners = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=np.float32)
    floor = (corners - (2 * SQUARE_PX - 0.5)) / SQUARE_PX * SQUARE_M * (1, -1)
    pixels = camera.project(np.column_stack([floor, np.zeros(4)])).astype(np.float32)
    moved = cv2.getPerspectiveTransform(corners, pixels)
    return np.asarray(cv2.warpPerspective(board, moved, camera.size, borderValue=200, flags=cv2.INTER_AREA), np.uint8)


def opposite(columns: int, rows: int, folder: Path, smaller: int = 1) -> Rig:
    """Three cameras around a board, with their pictures of it, so many times smaller than 1280x720."""
    middle = np.array([columns * SQUARE_M / 2, -rows * SQUARE_M / 2, 0])
    places = {"near": (0.4, -3.0, 2.0), "beside": (3.0, -0.5, 2.0), "far": (0.4, 2.5, 2.0)}
    cameras = [
        Camera.looking_at(name, (1280 // smaller, 720 // smaller), 1500 / smaller, at, middle)
        for name, at in places.items()
    ]
    for camera in cameras:
        cv2.imwrite(str(folder / f"{camera.name}.png"), board_in(camera, columns, rows))
    return Rig(tuple(cameras))


@pytest.mark.parametrize(("columns", "rows"), [(9, 6), (8, 6), (9, 7), (7, 7)])
def test_the_floor_is_level_from_whichever_end_a_view_has_the_board(columns: int, rows: int, tmp_path: Path) -> None:
    rig = opposite(columns, rows, tmp_path)
    frame = WorldFrame(
        board=str(tmp_path / "{view}.png"), board_columns=columns, board_rows=rows, board_square_m=SQUARE_M
    )
    placed, motion, source = frame.placed(rig, None, np.zeros(3))
    floor = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]) @ motion[:3, :3].T + motion[:3, 3]
    np.testing.assert_allclose(floor[:, 2], 0, atol=0.003)
    np.testing.assert_allclose([camera.centre[2] for camera in placed.cameras], 2.0, atol=0.01)
    assert ("look at which corner the origin is" in source) == ((columns, rows) != (9, 6))


def test_a_board_that_is_another_is_refused(tmp_path: Path) -> None:
    rig = opposite(9, 6, tmp_path)
    frame = WorldFrame(board=str(tmp_path / "{view}.png"), board_columns=9, board_rows=6, board_square_m=0.03)
    with pytest.raises(CalibrationError, match=r"fit its plan to 0\.\d+ m only.*board_square_m = 0\.03"):
        frame.placed(rig, None, np.zeros(3))


def test_a_floor_board_counted_in_squares_is_told(tmp_path: Path) -> None:
    rig = opposite(9, 6, tmp_path, smaller=2)
    frame = WorldFrame(board=str(tmp_path / "{view}.png"), board_columns=10, board_rows=7, board_square_m=SQUARE_M)
    with pytest.raises(CalibrationError, match=r"of 10x7 inner corners.*board_columns = 9, board_rows = 6 is seen$"):
        frame.placed(rig, None, np.zeros(3))
