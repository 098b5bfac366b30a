"""Cameras with fisheye lenses, calibrated with a board."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from tracker.cameras.calibration._board_start import board_start
from tracker.cameras.calibration.chessboard import BoardImages, ChessboardCalibration
from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array
from tracker.kernels.rows import BundleCameraRow

SIZE = (1280, 720)
# Of a sports camera: 130 degrees from corner to corner.
MATRIX = np.array([[640.0, 0, 645], [0, 641.0, 355], [0, 0, 1]])
TERMS = np.array([0.03, 0.012, -0.008, 0.002])
NOISE_PX = 0.1


def fisheye_images(camera: Camera, points: Array) -> Array:
    """Pixels (N, 2) as OpenCV's fisheye model has them; NaN outside of the image and more than 80 degrees off."""
    local = camera.in_camera(points)
    before = local[:, 2] > np.tan(np.radians(10)) * np.linalg.norm(local[:, :2], axis=1)
    plane = np.where(before[:, None], local[:, :2] / local[:, 2:], 0.0)
    pixels = cv2.fisheye.distortPoints(plane[:, None], MATRIX, TERMS)[:, 0]
    inside = ((pixels >= 0) & (pixels <= np.array(SIZE) - 1)).all(axis=1)
    return np.where((before & inside)[:, None], pixels, np.nan)


def three_cameras() -> list[Camera]:
    places = {"left": (-1.2, 0.0, 1.4), "middle": (0.0, -0.2, 1.5), "right": (1.2, 0.0, 1.3)}
    return [Camera.looking_at(name, SIZE, 640.0, at, np.array([0, 1.6, 1.2])) for name, at in places.items()]


def boards_seen(
    cameras: list[Camera],
    n: int = 40,
    imaged: Callable[[Camera, Array], Array] = fisheye_images,
    room: tuple[tuple[float, float, float], tuple[float, float, float]] = ((-1.1, 0.6, 0.7), (1.1, 1.8, 2.0)),
) -> BoardImages:
    """Corners of a board that is carried through the room before the cameras."""
    rng = np.random.default_rng(3)
    columns, rows = np.meshgrid(np.arange(9.0), np.arange(6.0))
    plan = 0.06 * np.column_stack([columns.ravel(), rows.ravel(), np.zeros(54)])
    seen = {}
    for frame in range(n):
        turn = Rotation.from_euler("x", 90, degrees=True) * Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3))
        corners = turn.apply(plan - (0.24, 0.15, 0)) + rng.uniform(*room)
        for v, camera in enumerate(cameras):
            pixels = imaged(camera, corners) + rng.normal(0, NOISE_PX, (54, 2))
            shown = np.isfinite(pixels).all(axis=1)
            if shown.sum() >= 6:
                seen[v, frame] = plan[shown], pixels[shown]
    return BoardImages(tuple(camera.name for camera in cameras), (SIZE,) * len(cameras), seen)


def gaps_px(camera: Camera, seen: Array) -> Array:
    """How far (N,) px a camera images from where the true lens does, where boards were seen."""
    plane = cv2.fisheye.undistortPoints(seen[:, None], MATRIX, TERMS)[:, 0]
    at_the_origin = replace(camera, camera_from_world=np.eye(4))
    found: Array = np.linalg.norm(at_the_origin.project(np.column_stack([plane, np.ones(len(plane))])) - seen, axis=1)
    return found


def test_a_board_calibrates_fisheye_lenses() -> None:
    """To the noise of the corners wherever the board was, of a lens that is not equidistant; distances to 2 mm."""
    truth = three_cameras()
    images = boards_seen(truth)
    calibration = ChessboardCalibration(columns=9, rows=6, square_m=0.06, lens="fisheye", sigma_px=NOISE_PX)
    found = calibration.calibrate_images(images)
    assert 0.8 < found.adjustment.s0 < 1.2
    as_pinhole = replace(calibration, lens="pinhole").calibrate_images(images)
    for v, camera in enumerate(found.rig.cameras):
        seen = np.concatenate([pixels for (view, _), (_, pixels) in images.seen.items() if view == v])
        # a principal point that is off takes the place of a turn: all gaps are alike
        assert np.max(gaps_px(camera, seen)) < 0.5
        assert np.nanmax(gaps_px(as_pinhole.rig.cameras[v], seen)) > 1.5
    assert any('lens = "fisheye"' in line for line in as_pinhole.advice)
    assert not any("fisheye" in line for line in found.advice)
    places = np.array([camera.centre for camera in found.rig.cameras])
    np.testing.assert_allclose(pdist(places), pdist(np.array([camera.centre for camera in truth])), atol=5e-4)


def test_an_equidistant_lens_is_found_from_few_boards() -> None:
    """Pixels to a radian, within what is adjusted afterwards."""
    images = boards_seen(three_cameras(), n=12)
    state, _ = board_start(images.seen, images.names, images.sizes, "fisheye")
    np.testing.assert_allclose(state.cameras[:, BundleCameraRow.C], MATRIX[1, 1], rtol=0.1)


def test_radial_terms_of_a_fisheye_lens_are_held_where_it_began() -> None:
    """Of few boards, all far: with 0 in place of a numerator's term the lens would be none, and nothing would fit."""
    images = boards_seen(three_cameras(), 12, room=((-0.3, 1.6, 1.0), (0.3, 2.4, 1.4)))
    calibration = ChessboardCalibration(columns=9, rows=6, square_m=0.06, lens="fisheye", sigma_px=NOISE_PX)
    found = calibration.calibrate_images(images)
    radial = [held for held in found.adjustment.held if held.parameter.startswith("radial")]
    assert radial
    assert all("held where the adjustment began" in str(held) for held in radial)
    for v, camera in enumerate(found.rig.cameras):
        seen = np.concatenate([pixels for (view, _), (_, pixels) in images.seen.items() if view == v])
        assert np.max(gaps_px(camera, seen)) < 6


def test_radial_terms_that_turn_back_inside_the_image_are_held() -> None:
    """Few boards, a lens that bends back in the corners where none of them was: said, and no such lens comes out."""
    folding = np.array([-0.374, 0.304, 0.0, 0.0, -0.252])
    matrix = np.array([[450.0, 0, 640], [0, 450, 360], [0, 0, 1]])
    truth = [replace(camera, matrix=matrix, distortion=folding) for camera in three_cameras()]

    def inside(camera: Camera, points: Array) -> Array:
        pixels = camera.project(points)
        shown = ((pixels >= 0) & (pixels <= np.array(SIZE) - 1)).all(axis=1)
        return np.where(shown[:, None], pixels, np.nan)

    images = boards_seen(truth, 12, inside)
    found = ChessboardCalibration(columns=9, rows=6, square_m=0.06, sigma_px=NOISE_PX).calibrate_images(images)
    assert any("turns back" in line and "inside the image" in line for line in found.advice)
    assert all(camera.turns_back_px is None for camera in found.rig.cameras)
