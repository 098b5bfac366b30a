"""Boards as they are printed, and as a camera sees them."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array, Image

SQUARE_PX, SQUARE_M = 40, 0.05


def chessboard(columns: int, rows: int) -> Image:
    """A chessboard of so many inner corners, with a white rim."""
    colours = 255 * (np.indices((rows + 1, columns + 1)).sum(axis=0) % 2)
    board = np.kron(colours, np.ones((SQUARE_PX, SQUARE_PX))).astype(np.uint8)
    return np.asarray(cv2.copyMakeBorder(board, *(SQUARE_PX,) * 4, cv2.BORDER_CONSTANT, value=255))


def charuco(columns: int, rows: int, dictionary: int = cv2.aruco.DICT_4X4_50, legacy: bool = False) -> Image:
    """A ChArUco board of so many squares, markers 0.75 of a square, with a white rim."""
    markers = cv2.aruco.getPredefinedDictionary(dictionary)
    board = cv2.aruco.CharucoBoard((columns, rows), 1.0, 0.75, markers)
    board.setLegacyPattern(legacy)
    size = (columns + 2) * SQUARE_PX, (rows + 2) * SQUARE_PX
    return np.asarray(board.generateImage(size, marginSize=SQUARE_PX))


def filmed(board: Image, camera: Camera, world_from_board: Array) -> Image:
    """A print as a camera sees it, its first corner inside the rim at the board's origin."""
    height, width = board.shape
    ends = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=np.float64)
    plan = ((ends + 0.5) / SQUARE_PX - 1) * SQUARE_M
    space = np.column_stack([plan, np.zeros(4)]) @ world_from_board[:3, :3].T + world_from_board[:3, 3]
    matrix = cv2.getPerspectiveTransform(ends.astype(np.float32), camera.project(space).astype(np.float32))
    fine = cv2.warpPerspective(
        board, np.diag([3.0, 3, 1]) @ matrix, (3 * camera.size[0], 3 * camera.size[1]), borderValue=120
    )
    return np.asarray(cv2.resize(fine, camera.size, interpolation=cv2.INTER_AREA))


def held(board: Image, middle: Sequence[float], turn: Rotation) -> Array:
    """(4, 4) world_from_board of a print whose middle is held at a place, turned."""
    height, width = board.shape
    pose = np.eye(4)
    pose[:3, :3] = turn.as_matrix()
    centre = SQUARE_M * (np.array([width, height]) / SQUARE_PX / 2 - 1)
    pose[:3, 3] = np.asarray(middle) - pose[:3, :2] @ centre
    return pose


def two_cameras() -> list[Camera]:
    """Half a metre apart, 0.9 m before boards that are held at (0, 0.9, 0)."""
    places = {"left": (-0.25, 0.0, 0.0), "right": (0.25, 0.0, 0.05)}
    return [Camera.looking_at(name, (480, 360), 430.0, at, (0.0, 0.9, 0.0)) for name, at in places.items()]


def shown_about(board: Image, n: int, tilt: float = 0.5, roll: float = 0.2) -> list[Array]:
    """(4, 4) poses of a print that is moved before the two cameras, each upright but for a tilt and a roll."""
    rng = np.random.default_rng(5)
    upright = Rotation.from_rotvec([-np.pi / 2, 0, 0])
    poses = []
    for _ in range(n):
        turn = upright * Rotation.from_rotvec([*rng.uniform(-tilt, tilt, 2), rng.uniform(-roll, roll)])
        x, y, z = rng.uniform(-0.06, 0.06, 3)
        poses.append(held(board, (x, 0.9 + y, z), turn))
    return poses
