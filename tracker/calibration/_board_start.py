"""Start values from boards: each camera's own calibration, then the cameras by the boards they see together."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from tracker.arrays import Array
from tracker.calibration._bundle import Observations, State
from tracker.calibration._objects import Boards
from tracker.calibration._states import camera_of, nominal_state, pinhole_of, state_of
from tracker.camera import Camera
from tracker.errors import CalibrationError
from tracker.fisheye import rational_of
from tracker.kernels.rows import bundle_camera

LensKind = Literal["pinhole", "fisheye"]

SeenCorners = dict[tuple[int, int], tuple[Array, Array]]
"""(view, frame) -> corners in the board's frame (N, 3) metres, and their pixels (N, 2)."""

FEWEST_BOARDS = 3
"""Zhang 2000, section 3.1: three views of a plane determine the interior."""

_FISHEYE_FOCALS, _FISHEYE_TRIES = (0.2, 1.0), 24
"""Pixels to a radian that are tried, as shares of the longer side (which then sees 57 to 286 degrees): 7 % apart."""


def board_start(
    seen: SeenCorners, names: Sequence[str], sizes: Sequence[tuple[int, int]], lens: LensKind = "pinhole"
) -> tuple[State, Observations]:
    """Cameras, board poses and observations.

    Args:
        seen: detected boards, six corners each at least.
        names: of the cameras, for messages.
        sizes: of their images, px.
        lens: kind of the lenses.

    Raises:
        CalibrationError: a camera saw too few boards, or none together with the others.
    """
    views = enumerate(zip(names, sizes, strict=True))
    cameras = np.stack([_camera(seen, v, name, size, lens) for v, (name, size) in views])
    camera_from_board = {key: _pose(cameras[key[0]], *found) for key, found in seen.items()}
    motions = _chained(camera_from_board, names)
    for v, motion in enumerate(motions):
        cameras[v, bundle_camera.ROTATION] = motion[:3, :3].ravel()
        cameras[v, bundle_camera.CENTRE] = -motion[:3, :3].T @ motion[:3, 3]
    frames = sorted({frame for _, frame in seen})
    world_from_board = []
    for frame in frames:
        guesses = [(len(seen[key][0]), key) for key in seen if key[1] == frame]
        _, best = max(guesses)
        world_from_board.append(np.linalg.inv(motions[best[0]]) @ camera_from_board[best])
    return _assembled(seen, frames, cameras, np.stack(world_from_board))


def _camera(seen: SeenCorners, view: int, name: str, size: tuple[int, int], lens: LensKind) -> Array:
    """(26,) camera constant and first distortion from some boards, principal point in the middle."""
    mine = [found for (v, _), found in sorted(seen.items()) if v == view]
    if len(mine) < FEWEST_BOARDS:
        raise CalibrationError(
            f'view "{name}": the board is seen in {len(mine)} frames, expected at least {FEWEST_BOARDS}; are the '
            "images blank or blurred, or columns, rows and dictionary not those of the board?"
        )
    chosen = [mine[k] for k in np.linspace(0, len(mine) - 1, min(len(mine), 30)).astype(int)]
    if lens == "fisheye":
        return _fisheye_camera(chosen, name, size)
    points = [np.ascontiguousarray(shape, dtype=np.float32) for shape, _ in chosen]
    pixels = [np.ascontiguousarray(found, dtype=np.float32) for _, found in chosen]
    flags = cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3
    guess = nominal_state(size, 1.1 * max(size))
    matrix = np.array([[guess[12], 0, guess[13]], [0, guess[12], guess[14]], [0, 0, 1.0]])
    _, matrix, terms, _, _ = cv2.calibrateCamera(
        points, pixels, size, matrix, np.zeros(5), flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS
    )
    guess[12] = matrix[1, 1]
    guess[17:19] = terms.ravel()[:2]
    return guess


def _fisheye_camera(chosen: Sequence[tuple[Array, Array]], name: str, size: tuple[int, int]) -> Array:
    """(26,) the equidistant lens by which the boards are most nearly flat; its numerator is adjusted later."""
    focals_px = np.geomspace(*_FISHEYE_FOCALS, _FISHEYE_TRIES) * max(size)
    cameras = [_equidistant(name, size, focal_px) for focal_px in focals_px]
    best = min(cameras, key=lambda camera: sum(_bent_px(camera, *one) for one in chosen))
    return state_of(best)


def _equidistant(name: str, size: tuple[int, int], focal_px: float) -> Camera:
    """A camera that images in proportion to the angle from its axis."""
    plain = camera_of(nominal_state(size, focal_px), name, size)
    return replace(plain, distortion=rational_of(name, size, plain.matrix, np.zeros(4)))


def _bent_px(camera: Camera, shape: Array, pixels: Array) -> float:
    """RMS of a board's corners beside the best homography of its plan, px; that of the image where there is none."""
    plane = camera.undistort(pixels)
    matrix = cv2.findHomography(shape[:, :2], plane)[0] if np.isfinite(plane).all() else None
    if matrix is None:
        return float(max(camera.size))
    flat = cv2.perspectiveTransform(shape[None, :, :2], matrix)[0]
    found = camera.project(np.column_stack([flat, np.ones(len(flat))]))
    gaps = np.where(np.isfinite(found), found - pixels, max(camera.size))
    return float(np.sqrt((gaps**2).sum(axis=1).mean()))


def _pose(camera: Array, shape: Array, pixels: Array) -> Array:
    """(4, 4) camera_from_board."""
    matrix = pinhole_of(camera)
    _, turn, shift = cv2.solvePnP(shape, pixels, matrix, camera[bundle_camera.DISTORTION], flags=cv2.SOLVEPNP_IPPE)
    turn, shift = cv2.solvePnPRefineLM(shape, pixels, matrix, camera[bundle_camera.DISTORTION], turn, shift)
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec(turn.ravel()).as_matrix()
    motion[:3, 3] = shift.ravel()
    return motion


def _chained(camera_from_board: dict[tuple[int, int], Array], names: Sequence[str]) -> list[Array]:
    """(4, 4) camera_from_world of every camera; the world is the first camera's frame."""
    shared: dict[tuple[int, int], list[Array]] = {}
    for (view, frame), motion in camera_from_board.items():
        for other in range(len(names)):
            if other != view and (other, frame) in camera_from_board:
                relative = motion @ np.linalg.inv(camera_from_board[other, frame])
                shared.setdefault((view, other), []).append(relative)
    known: dict[int, Array] = {0: np.eye(4)}
    while len(known) < len(names):
        links = [(len(shared.get((view, other), [])), view, other) for view, other in _open_links(names, known)]
        n_frames, view, other = max(links)
        if n_frames == 0:
            lacking = [name for v, name in enumerate(names) if v not in known]
            raise CalibrationError(
                f"{', '.join(lacking)}: no frame shows the board together with {', '.join(names[v] for v in known)}; "
                "hold it where both see it"
            )
        known[view] = _median_motion(np.stack(shared[view, other])) @ known[other]
    return [known[v] for v in range(len(names))]


def _open_links(names: Sequence[str], known: dict[int, Array]) -> list[tuple[int, int]]:
    unknown = [v for v in range(len(names)) if v not in known]
    return list(itertools.product(unknown, known))


def _median_motion(motions: Array) -> Array:
    """The one of (N, 4, 4) motions that the others are nearest to."""
    angles = Rotation.from_matrix(motions[:, :3, :3])
    spread = [np.median((angles.inv() * angles[k]).magnitude()) for k in range(len(motions))]
    shifts = np.linalg.norm(motions[:, None, :3, 3] - motions[None, :, :3, 3], axis=2)
    size = max(float(np.median(np.linalg.norm(motions[:, :3, 3], axis=1))), 1e-9)
    best: Array = motions[int(np.argmin(np.array(spread) + np.median(shifts, axis=1) / size))]
    return best


def _assembled(seen: SeenCorners, frames: list[int], cameras: Array, poses: Array) -> tuple[State, Observations]:
    """One point for every corner of every pose that a view shows; the observations sorted by pose."""
    shapes: list[Array] = []
    pixels: list[Array] = []
    owners: list[int] = []
    views: list[int] = []
    points: list[int] = []
    for g, frame in enumerate(frames):
        numbers: dict[tuple[float, ...], int] = {}
        for view in range(len(cameras)):
            for corner, pixel in zip(*seen.get((view, frame), (np.zeros((0, 3)), np.zeros((0, 2)))), strict=True):
                key = tuple(np.round(corner, 6))
                if key not in numbers:
                    numbers[key] = len(shapes)
                    shapes.append(corner)
                    owners.append(g)
                views.append(view)
                points.append(numbers[key])
                pixels.append(pixel)
    boards = Boards(np.stack(shapes), np.array(owners, dtype=np.int64), poses)
    images = np.stack(pixels)
    observations = Observations(np.array(views), np.array(points), images, np.zeros_like(images))
    return State(cameras, boards), observations
