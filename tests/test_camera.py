"""Cameras: OpenCV as oracle, derivatives against differences, inverses, and values no camera can have."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from rig_samples import FISHEYE
from rounding import assert_alike

from tracker.cameras.camera import Camera
from tracker.cameras.lens import Lens
from tracker.cameras.rig import Rig
from tracker.cameras.rig_check import check_rig
from tracker.foundation.arrays import Array
from tracker.foundation.errors import CalibrationError
from tracker.kernels.projection import undistort

TERMS = ("k1", "k2", "p1", "p2", "k3")
LENSES = {
    "none": (0.0, 0.0, 0.0, 0.0, 0.0),
    **{term: tuple(0.1 * (term == other) for other in TERMS) for term in TERMS},
    "all": (-0.28, 0.09, 0.002, -0.003, -0.012),
    "rational": (0.7313, 0.0891, 0.002, -0.003, 9e-4, 1.0643, 0.2454, 9.2e-3),
}


def camera_with(lens: str = "all", shear: float = 0.0) -> Camera:
    motion = np.eye(4)
    motion[:3, :3] = cv2.Rodrigues(np.array([0.3, -1.1, 0.7]))[0]
    motion[:3, 3] = 0.2, -0.4, 4.0
    matrix = np.array([[810.0, shear, 362.5], [0, 790.0, 281.0], [0, 0, 1]])
    return Camera("north", (720, 576), matrix, np.array(LENSES[lens]), motion)


def points_in_view(camera: Camera, n: int = 200) -> Array:
    """World points over the whole image, 2 to 7 m deep."""
    rng = np.random.default_rng(5)
    depth = rng.uniform(2.0, 7.0, n)
    local = np.stack([rng.uniform(-0.42, 0.42, n) * depth, rng.uniform(-0.34, 0.34, n) * depth, depth], axis=1)
    points: Array = (local - camera.camera_from_world[:3, 3]) @ camera.camera_from_world[:3, :3]
    return points


@pytest.mark.parametrize("lens", LENSES)
def test_projection_is_that_of_opencv(lens: str) -> None:
    camera = camera_with(lens)
    points = points_in_view(camera)
    theirs, _ = cv2.projectPoints(
        points, camera.rotation_vector(), camera.camera_from_world[:3, 3], camera.matrix, camera.distortion
    )
    np.testing.assert_allclose(camera.project(points), theirs[:, 0], atol=1e-9)


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("shear", [0.0, 12.0])
def test_jacobian_equals_finite_differences(lens: str, shear: float) -> None:
    camera = camera_with(lens, shear)
    points = points_in_view(camera)
    step = 1e-6
    moves = step * np.eye(3)
    differences = np.stack([camera.project(points + d) - camera.project(points - d) for d in moves], axis=-1)
    np.testing.assert_allclose(camera.project_jacobian(points), differences / (2 * step), atol=1e-5)


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("shear", [0.0, 12.0])
def test_undistortion_inverts_projection(lens: str, shear: float) -> None:
    camera = camera_with(lens, shear)
    points = points_in_view(camera)
    local = camera.in_camera(points)
    np.testing.assert_allclose(camera.undistort(camera.project(points)), local[:, :2] / local[:, 2:], atol=1e-11)


STRETCHING = (
    (0.175, 0.148, 0.001, 0.001, -0.117, 0, 0, 0),
    (0.724, -0.97, 0, 0, 0, 0, 0, 0),
    (0.132, -0.102, 0.002, 0, 0.159, 0, 0, 0),
    (0.239, 0.173, 0, 0.001, 0.119, -0.093, 0.032, -0.152),
)


@pytest.mark.parametrize("lens", STRETCHING)
def test_what_a_lens_images_farther_out_than_it_is_comes_back(lens: tuple[float, ...]) -> None:
    """Where a lens stretches the image, what is imaged may lie beyond its reach, where its slope leads elsewhere."""
    found = Lens(np.array(lens))
    radii, angles = np.linspace(0, 0.95 * min(found.reach, 2.5), 60), np.linspace(0, 6, 7)[:, None]
    plane = np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=-1)
    imaged, _ = found.distort(plane)
    np.testing.assert_allclose(found.undistort(imaged), plane, atol=1e-9)
    np.testing.assert_allclose(found.undistort(imaged[3, -1]), plane[3, -1], atol=1e-9)
    if np.isfinite(found.reach):
        end, _ = found.distort(np.array([found.reach, 0.0]))
        assert np.isnan(found.undistort(np.array([1.05 * end[0], 0.0]))).all()


@pytest.mark.parametrize("lens", [*STRETCHING, LENSES["all"], LENSES["rational"], (-0.3, 0, 0, 0, 0), LENSES["none"]])
def test_the_kernel_of_contours_undistorts_as_cameras_do(lens: tuple[float, ...]) -> None:
    """Within the reach of the lens, at its very end, and beyond, where both are at the end."""
    matrix = np.array([[500.0, 3.0, 360], [0, 480, 288], [0, 0, 1]])
    camera = Camera("a", (720, 576), matrix, np.array(lens), np.eye(4))
    radii, angles = np.linspace(0.01, 0.95 * min(camera.reach, 1.8), 30), np.linspace(0, 6, 7)[:, None]
    plane = np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=-1).reshape(-1, 2)
    imaged = Lens(camera.distortion).distort(plane)[0] @ matrix[:2, :2].T + matrix[:2, 2]
    row = Rig((camera,)).packed[0]
    found = np.array([undistort(row, *pixel) for pixel in imaged])
    np.testing.assert_allclose(found, plane, atol=1e-9)
    np.testing.assert_allclose(found, camera.undistort(imaged), atol=1e-9)
    if np.isfinite(camera.reach):
        beyond = matrix[:2, 2] + 3 * (imaged[radii.argmax() :: len(radii)] - matrix[:2, 2])
        found = np.array([undistort(row, *pixel) for pixel in beyond])
        np.testing.assert_allclose(found, camera.undistort(beyond, clamped=True), atol=1e-9)


@pytest.mark.parametrize("shear", [0.0, 12.0])
def test_the_ray_of_a_pixel_meets_its_point(shear: float) -> None:
    camera = camera_with(shear=shear)
    points = points_in_view(camera)
    rays = camera.rays(camera.project(points))
    distance = np.linalg.norm(points - camera.centre, axis=1)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(camera.centre + distance[:, None] * rays, points, atol=1e-9)


def test_any_leading_axes_are_kept() -> None:
    camera = camera_with()
    points = points_in_view(camera, 24)
    pixels = camera.project(points)
    assert_alike(camera.project(points.reshape(2, 3, 4, 3)), pixels.reshape(2, 3, 4, 2))
    assert_alike(camera.project(points[0]), pixels[0])
    assert camera.project_jacobian(points.reshape(4, 6, 3)).shape == (4, 6, 2, 3)
    np.testing.assert_allclose(camera.rays(pixels.reshape(4, 6, 2))[1, 2], camera.rays(pixels[8]), atol=1e-12)


def test_points_behind_the_camera_have_no_image() -> None:
    camera = camera_with()
    in_front = points_in_view(camera, 8)
    behind = 2 * camera.centre - in_front
    assert np.isfinite(camera.project(in_front)).all()
    assert np.isnan(camera.project(behind)).all()
    assert np.isnan(camera.project(camera.centre)).all()


@pytest.mark.parametrize("factor", [2, 3, 5])
def test_downscaling_follows_the_averaged_image(factor: int) -> None:
    """On a ramp, averaged pixels hold the ramp's value at their centres: both cameras must read the same."""
    camera = replace(camera_with(), size=(720, 570))
    smaller = camera.downscaled(factor)
    assert smaller.size == (720 // factor, 570 // factor)
    rows, columns = np.mgrid[: camera.size[1], : camera.size[0]].astype(np.float32)
    points = points_in_view(camera)
    for ramp in (columns, rows):
        average = cv2.resize(ramp, smaller.size, interpolation=cv2.INTER_AREA)
        slope = np.array([average[0, 1] - average[0, 0], average[1, 0] - average[0, 0]])
        expected = camera.project(points)[:, 0 if ramp is columns else 1]
        np.testing.assert_allclose(average[0, 0] + smaller.project(points) @ slope, expected, atol=1e-3)


def test_enlarging_follows_the_enlarged_image() -> None:
    """On a ramp the enlarged image holds the ramp's value at the centres of its pixels, but at the border."""
    camera = replace(camera_with(), size=(720, 570))
    larger = camera.downscaled(0.5)
    assert (larger.size, larger.downscale) == ((1440, 1140), 0.5)
    points = points_in_view(camera)
    rows, columns = np.mgrid[: camera.size[1], : camera.size[0]].astype(np.float32)
    for axis, ramp in enumerate((columns, rows)):
        enlarged = cv2.resize(ramp, larger.size, interpolation=cv2.INTER_CUBIC)
        pixels = larger.project(points)
        inside = ((pixels > 4) & (pixels < np.array(larger.size) - 5)).all(axis=1)
        found = cv2.remap(enlarged, *pixels[inside].astype(np.float32).T, cv2.INTER_LINEAR).ravel()
        np.testing.assert_allclose(found, camera.project(points[inside])[:, axis], atol=0.05)
    np.testing.assert_allclose(larger.downscaled(2).matrix, camera.matrix, atol=1e-12)


def test_a_camera_that_looks_at_a_point() -> None:
    target = np.array([0.3, -0.2, 1.0])
    camera = Camera.looking_at("door", (640, 480), 500.0, (4.0, 3.0, 2.5), target)
    np.testing.assert_allclose(camera.centre, (4, 3, 2.5), atol=1e-12)
    np.testing.assert_allclose(camera.project(target), (319.5, 239.5), atol=1e-9)
    u, v = camera.project(target + np.array([0, 0, 0.1]))
    assert u == pytest.approx(319.5)
    assert v < 239.5


FOLDING = np.array([-0.374, 0.304, 0.0, 0.0, -0.252])
"""Of six views of a board: the radial terms fit where it was, and turn back beyond."""


@pytest.mark.parametrize(
    ("lens", "turns"),
    [
        (FOLDING, True),
        ((-0.2, 0.05, 0.001, -0.002, 0.0), False),
        ((0.1, 0, 0, 0, 0), False),
        ((-0.3, 0, 0, 0, 0), True),
        (FISHEYE, False),
        ((0, 0, 0, 0, 0, 1, 0, 0), True),
        ((0.1, 0, 0, 0, 0, -0.5, 0, 0), True),
    ],
)
def test_the_reach_ends_where_the_distortion_turns_back(lens: Any, turns: bool) -> None:
    """Along every ray from the axis the image moves outwards, up to the reach and no farther."""
    camera = replace(GOOD, distortion=np.array(lens), matrix=np.array([[500.0, 0, 360], [0, 500, 288], [0, 0, 1]]))
    radii = np.linspace(0, min(camera.reach, 3.0), 2000)[1:-1]
    k1, k2, _, _, k3, k4, k5, k6 = camera.distortion
    images = radii * (1 + k1 * radii**2 + k2 * radii**4 + k3 * radii**6)
    images /= 1 + k4 * radii**2 + k5 * radii**4 + k6 * radii**6
    assert (np.diff(images) > 0).all()
    assert np.isfinite(Lens(camera.distortion).turns_back) == turns
    if turns:
        just, beyond = np.array([0.999, 1.001]) * camera.reach
        ray = camera.camera_from_world[:3, :3].T @ np.array([[just, 0, 1], [beyond, 0, 1]]).T + camera.centre[:, None]
        assert np.isfinite(camera.project(ray.T)).all(axis=1).tolist() == [True, False]


def test_a_lens_that_images_to_infinity_does_not_turn_back() -> None:
    for pole in np.linspace(0.3, 0.7, 9):
        camera = replace(GOOD, distortion=np.array([0.1, 0, 0, 0, 0, -pole, 0, 0]))
        assert camera.reach == pytest.approx(pole**-0.5)
        assert camera.turns_back_px is None


def test_a_lens_that_turns_back_inside_the_image_is_told() -> None:
    """Of the same lens a long one images only what lies within its reach."""
    wide = replace(GOOD, distortion=FOLDING, matrix=np.array([[400.0, 0, 360], [0, 400, 288], [0, 0, 1]]))
    long = replace(wide, matrix=np.array([[1500.0, 0, 360], [0, 1500, 288], [0, 0, 1]]))
    radii = np.linspace(0, 1.2, 100_001)
    images = radii * (1 - 0.374 * radii**2 + 0.304 * radii**4 - 0.252 * radii**6)
    assert wide.turns_back_px == pytest.approx(400 * images[np.argmax(np.diff(images) < 0)], rel=1e-6)
    assert long.turns_back_px is None
    other = Camera.looking_at("other", (720, 576), 600.0, (0.0, 4.0, 1.5), np.array([0.0, 0.0, 1.0]))
    doubts = check_rig(Rig((replace(wide, name="wide"), other))).doubts
    assert any("wide's distortion turns back 2" in doubt and "inside the image" in doubt for doubt in doubts)


def test_values_are_copied_and_cannot_be_changed() -> None:
    matrix = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    camera = Camera("a", (640, 480), matrix, np.zeros(5), np.eye(4))
    matrix[0, 0] = 1.0
    assert camera.matrix[0, 0] == 500
    with pytest.raises(ValueError, match="read-only"):
        camera.matrix[0, 0] = 1.0


def changed(values: Any, index: tuple[int, ...], value: float) -> Array:
    array = np.array(values, dtype=np.float64)
    array[index] = value
    return array


GOOD = camera_with()
MIRRORED = np.diag([-1.0, 1, 1, 1]) @ GOOD.camera_from_world
WRONG = {
    "negative focal length": ({"matrix": changed(GOOD.matrix, (0, 0), -810.0)}, "focal length -810"),
    "no focal length": ({"matrix": changed(GOOD.matrix, (1, 1), 0.0)}, "focal length"),
    "not intrinsic": ({"matrix": changed(GOOD.matrix, (2, 0), 0.5)}, "intrinsic matrix"),
    "transposed intrinsic": ({"matrix": GOOD.matrix.T}, "intrinsic matrix"),
    "principal point": ({"matrix": changed(GOOD.matrix, (0, 2), 1900.0)}, "720x576 image: calibrated at another"),
    "empty image": ({"size": (0, 576)}, "image size 0x576"),
    "mirrored": ({"camera_from_world": MIRRORED}, "not a rotation.*det R = -1"),
    "scaled": ({"camera_from_world": np.diag([2.0, 2, 2, 1])}, "not a rotation"),
    "transposed motion": ({"camera_from_world": GOOD.camera_from_world.T}, "last row|not a rotation"),
    "3x4 motion": ({"camera_from_world": np.eye(4)[:3]}, r"camera_from_world: shape \(3, 4\) found, \(4, 4\)"),
    "three lens terms": ({"distortion": np.zeros(3)}, r"distortion: shape \(3,\) found, \(8\)"),
    "not a number": ({"distortion": changed(np.zeros(5), (1,), np.nan)}, "distortion.*finite"),
}


@pytest.mark.parametrize("fault", WRONG)
def test_a_camera_that_cannot_be_is_refused(fault: str) -> None:
    change, reason = WRONG[fault]
    with pytest.raises(CalibrationError, match=reason) as refusal:
        replace(GOOD, **change)  # type: ignore[arg-type]
    assert '"north"' in str(refusal.value)
    assert "\n" not in str(refusal.value)
