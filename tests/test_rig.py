"""Rigs: triangulation against truth and an optimizer, its covariance against noise, epipolar lines, packed rows."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from rounding import assert_alike
from scipy.optimize import least_squares

from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array
from tracker.foundation.errors import CalibrationError

LENS = np.array([-0.2, 0.05, 0.001, -0.002, -0.01])
PLACES = {"front": (4.0, 0.3, 1.6), "left": (-0.4, 4.5, 2.2), "back": (-4.2, -0.2, 1.4), "right": (0.5, -3.8, 2.6)}


def four_views(shear: float = 3.0) -> Rig:
    cameras = []
    for k, (name, place) in enumerate(PLACES.items()):
        plain = Camera.looking_at(name, (720, 576), 700.0 + 20 * k, place, np.array([0, 0, 1.0]))
        matrix = plain.matrix + np.array([[0, shear, 2 * k], [0, 0, -k], [0, 0, 0]])
        cameras.append(replace(plain, matrix=matrix, distortion=LENS * (k != 2)))
    return Rig(tuple(cameras))


def points_in_the_room(n: int, seed: int = 1) -> Array:
    return np.random.default_rng(seed).uniform((-0.8, -0.8, 0.1), (0.8, 0.8, 1.9), (n, 3))


def test_projection_is_every_camera_in_turn() -> None:
    rig, points = four_views(), points_in_the_room(6)
    pixels = rig.project(points.reshape(2, 3, 3))
    assert pixels.shape == (4, 2, 3, 2)
    for v, camera in enumerate(rig.cameras):
        assert_alike(pixels[v].reshape(6, 2), camera.project(points))


def test_triangulation_inverts_projection_with_whatever_views_there_are() -> None:
    rig, points = four_views(), points_in_the_room(300)
    pixels = rig.project(points)
    hidden = np.random.default_rng(2).random((4, 300)) < 0.45
    pixels[hidden] = np.nan
    found, covariance = rig.triangulate(pixels)
    enough = (~hidden).sum(axis=0) >= 2
    assert 50 < enough.sum() < 290
    np.testing.assert_allclose(found[enough], points[enough], atol=1e-9)
    assert np.isfinite(covariance[enough]).all()
    assert np.isnan(found[~enough]).all()
    assert np.isnan(covariance[~enough]).all()


def test_one_missing_coordinate_hides_the_view() -> None:
    rig, points = four_views(), points_in_the_room(1)
    pixels = rig.project(points)
    pixels[0, 0] = np.nan, -1e5
    np.testing.assert_allclose(rig.triangulate(pixels)[0], points, atol=1e-9)


def test_no_point_and_no_view_give_no_point() -> None:
    rig = four_views()
    assert rig.triangulate(np.empty((4, 0, 2)))[0].shape == (0, 3)
    assert np.isnan(rig.triangulate(np.full((4, 5, 2), np.nan))[0]).all()


def test_rays_that_do_not_meet_leave_the_other_points_alone() -> None:
    """Two cameras side by side looking the same way: equal pixels never meet, crossed ones meet behind."""
    left, right = (
        Camera.looking_at(name, (640, 480), 500.0, (4.0, y, 1.0), np.array([0, y, 1.0]))
        for name, y in (("left", -0.1), ("right", 0.1))
    )
    rig = Rig((left, right))
    point = np.array([0.5, 0.2, 1.3])
    pixels = np.stack([rig.project(point), [(320, 240), (320, 240)], [(310, 240), (330, 240)]], axis=1)
    found, covariance = rig.triangulate(pixels)
    np.testing.assert_allclose(found[0], point, atol=1e-9)
    assert np.isfinite(covariance[0]).all()
    assert np.isnan(found[1:]).all()
    assert np.isnan(covariance[1:]).all()


def test_triangulation_is_the_optimizers_least_reprojection_error() -> None:
    rig, points = four_views(), points_in_the_room(10)
    noise = np.random.default_rng(3).normal(0, 3.0, (4, 10, 2))
    pixels = rig.project(points) + noise
    found, _ = rig.triangulate(pixels)
    for k in range(10):

        def residual(point: Array, k: int = k) -> Array:
            return (rig.project(point) - pixels[:, k]).ravel()

        best = least_squares(residual, points[k], xtol=1e-14, ftol=1e-14, gtol=1e-14)
        np.testing.assert_allclose(found[k], best.x, atol=1e-6)


def test_covariance_is_that_of_the_noise() -> None:
    """Squared errors weighted by the stated covariance average 3, with variance 6 / N."""
    rig, n, sigma_px = four_views(), 4000, 0.5
    points = points_in_the_room(n)
    rng = np.random.default_rng(4)
    pixels = rig.project(points) + rng.normal(0, sigma_px, (4, n, 2))
    pixels[rng.integers(0, 4, n), np.arange(n)] = np.nan
    found, covariance = rig.triangulate(pixels, sigma_px)
    error = found - points
    weighted = (error[:, None] @ np.linalg.inv(covariance) @ error[:, :, None]).ravel()
    assert weighted.mean() == pytest.approx(3, abs=4 * np.sqrt(6 / n))
    np.testing.assert_allclose(covariance, np.swapaxes(covariance, 1, 2), atol=1e-15)


def test_covariance_grows_along_the_rays_of_a_narrow_pair() -> None:
    """Two cameras 10 cm apart see depth far worse than width: by about distance over base."""
    target = np.array([0, 0, 1.0])
    left = Camera.looking_at("l", (640, 480), 600.0, (4.0, 0.05, 1.0), target)
    right = Camera.looking_at("r", (640, 480), 600.0, (4.0, -0.05, 1.0), target)
    rig = Rig((left, right))
    _, covariance = rig.triangulate(rig.project(target[None]))
    sigmas, axes = np.linalg.eigh(covariance[0])
    assert abs(axes[0, 2]) == pytest.approx(1, abs=1e-6)
    assert np.sqrt(sigmas[2] / sigmas[0]) == pytest.approx(2 * 4.0 / 0.1, rel=0.02)


@pytest.mark.parametrize(("source", "target"), [(0, 1), (1, 2), (2, 3), (3, 0)])
def test_the_epipolar_line_runs_through_the_same_point(source: int, target: int) -> None:
    rig = four_views()
    for point in points_in_the_room(20):
        here, there = rig.cameras[source].project(point), rig.cameras[target].project(point)
        line = rig.epipolar_line(here, source, target, n_points=400)
        along = np.diff(line, axis=0)
        share = ((there - line[:-1]) * along).sum(axis=1) / (along**2).sum(axis=1)
        nearest = line[:-1] + share.clip(0, 1)[:, None] * along
        assert np.linalg.norm(nearest - there, axis=1).min() < 0.05


def test_epipolar_lines_leave_out_what_lies_behind_the_target() -> None:
    target = np.array([0, 0, 1.0])
    rear = Camera.looking_at("rear", (640, 480), 500.0, (6.0, 0.4, 1.0), target)
    front = Camera.looking_at("front", (640, 480), 500.0, (3.0, 0.0, 1.0), target)
    line = Rig((rear, front)).epipolar_line(np.array([300.0, 200.0]), 0, 1)
    assert 0 < len(line) < 64
    assert np.isfinite(line).all()


def test_packed_rows_hold_all_of_a_camera() -> None:
    rig, points = four_views(), points_in_the_room(30)
    assert rig.packed.shape == (4, 29)
    for row, camera in zip(rig.packed, rig.cameras, strict=True):
        motion, centre, lens, shear = row[:12].reshape(3, 4), row[12:15], np.r_[row[19:24], row[25:28]], row[24]
        fx, fy, cx, cy = row[15:19]
        matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        pixels, _ = cv2.projectPoints(points, cv2.Rodrigues(motion[:, :3])[0], motion[:, 3], matrix, lens)
        pixels = pixels[:, 0]
        pixels[:, 0] += shear * (pixels[:, 1] - cy) / fy
        np.testing.assert_allclose(pixels, camera.project(points), atol=1e-8)
        np.testing.assert_array_equal(centre, camera.centre)
    np.testing.assert_array_equal(rig.sizes, [(720, 576)] * 4)
    assert not rig.packed.flags.writeable


def test_selection_keeps_the_wanted_order() -> None:
    rig = four_views()
    chosen = rig.select(("back", "front"))
    assert chosen.names == ("back", "front")
    assert len(chosen) == 2
    assert chosen.cameras[1] is rig.cameras[0]
    assert rig.index("right") == 3
    with pytest.raises(CalibrationError, match=r'no camera "frnt".*did you mean "front"'):
        rig.select(("frnt",))


def test_downscaling_scales_every_view() -> None:
    rig, points = four_views(), points_in_the_room(5)
    np.testing.assert_allclose(rig.downscaled(2).project(points), (rig.project(points) - 0.5) / 2, atol=1e-9)


def test_rigs_that_cannot_be_are_refused() -> None:
    front, left = four_views().cameras[:2]
    with pytest.raises(CalibrationError, match="no camera"):
        Rig(())
    with pytest.raises(CalibrationError, match='two cameras are called "front"'):
        Rig((front, replace(left, name="front")))
    with pytest.raises(CalibrationError, match='"front" and "copy" stand at one place'):
        Rig((front, left, replace(front, name="copy")))


def test_a_pair_of_cameras_close_together_sees_a_small_thing_in_space() -> None:
    middle = (0.0, 0.0, 0.01)
    places = {"left": (0.1, 0.0, 0.05), "right": (0.1, 0.005, 0.05)}
    rig = Rig(tuple(Camera.looking_at(name, (640, 480), 800.0, place, middle) for name, place in places.items()))
    points = np.array([middle, (0.01, 0.01, 0.02)])
    np.testing.assert_allclose(rig.triangulate(rig.project(points))[0], points, atol=1e-9)
