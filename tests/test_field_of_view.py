"""Beyond the field of view of a lens: nothing is imaged there, by whatever way it is projected."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rounding import assert_alike

from tracker._native import project_grid, see_vertices
from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Person, Scene
from tracker.cameras.camera import Camera, rational_of, told_end
from tracker.cameras.rig import Rig
from tracker.cameras.rig_check import check_rig
from tracker.cameras.rig_layouts import read_rig, save_rig
from tracker.foundation.arrays import Array32
from tracker.kernels.projection import project_point
from tracker.results.recording._player import _camera
from tracker.synthesis._pictures import rasterized_ids
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.osmesa import pinhole_of
from tracker.synthesis.simulation.room import background_plates

BARREL = replace(
    Camera.looking_at("barrel", (1280, 720), 1100, (0, -4, 1), np.array([0, 0, 1.0])),
    distortion=np.array([-0.3, 0, 0, 0, 0]),
)
"""Its distortion turns back 46 degrees off the axis, outside of the image."""

BESIDE = 2.8
"""Metres beside the axis, 2 m before the camera: 54 degrees off it."""


def standing(body: BodyModel, *places: float) -> Scene:
    """Persons 2 m before the camera, so many metres beside its axis."""
    persons = []
    for n, place in enumerate(places):
        q = body.rest().copy()
        q[:3] = place, -2, 0.9
        persons.append(Person(str(n), body, q))
    return Scene(tuple(persons), Rig((BARREL,)))


def contour(scene: Scene) -> Array32:
    """(N, 5) samples."""
    found = CpuSynthesis(step_px=4.0).contours(scene)
    return found.positions[0, 0, : found.counts[0, 0]]


def test_who_is_outside_of_it_is_nowhere(body: BodyModel) -> None:
    alone = standing(body, BESIDE)
    assert BARREL.turns_back_px is None
    assert not len(contour(alone))
    assert not CpuSynthesis().silhouettes(alone)[0].any()
    assert (rasterized_ids(alone, 13, 24)[0] < 0).all()


def test_who_is_outside_of_it_changes_nothing_of_who_is_inside(body: BodyModel) -> None:
    one, both = standing(body, 0.0), standing(body, 0.0, BESIDE)
    assert_alike(contour(one), contour(both))
    np.testing.assert_array_equal(CpuSynthesis().silhouettes(one)[0], CpuSynthesis().silhouettes(both)[0])
    seen, beside = (rasterized_ids(scene, 13, 24)[0] for scene in (one, both))
    assert (seen >= 0).sum() > 10_000
    np.testing.assert_array_equal(seen, beside)


@pytest.mark.parametrize(("beside", "imaged"), [(2.0, True), (2.2, False)])  # 45 and 47.7 degrees
def test_kernels_end_where_the_lens_does(beside: float, imaged: bool) -> None:
    point, row = np.array([beside, -2.0, 1.0]), Rig((BARREL,)).packed[0]
    assert np.isfinite(BARREL.project(point)).all() == imaged
    assert (project_point(row, *point)[2] > 0) == imaged
    pixels, seen, facing = np.zeros((3, 1)), np.zeros((1, 3), np.float32), np.zeros(1, np.float32)
    assert (project_grid(np.eye(4), point[None].astype(np.float32), row, pixels) > 0) == imaged
    see_vertices(point[None].astype(np.float32), np.ones((1, 3), np.float32), row.astype(np.float32), seen, facing)
    assert (seen[0, 2] > 0) == imaged


FOLDING = replace(BARREL, matrix=np.diag([900.0, 900, 1]) + np.array([[0, 0, 639.5], [0, 0, 359.5], [0, 0, 0]]))
"""The same lens, so short that it turns back 632 px from the principal point, inside the image."""


def test_pixels_that_a_lens_images_nothing_to_have_no_direction() -> None:
    pixels = np.array([[1000.0, 300.0], [1279.0, 359.5], [1279.0, 719.0]])
    plane = FOLDING.undistort(pixels)
    np.testing.assert_array_equal(np.isfinite(plane).all(axis=1), [True, False, False])
    assert np.isnan(FOLDING.undistort(pixels[2])).all()
    points = FOLDING.centre + FOLDING.rays(pixels[:1])
    np.testing.assert_allclose(FOLDING.project(points), pixels[:1])
    np.testing.assert_allclose(np.linalg.norm(FOLDING.undistort(pixels[1:], clamped=True), axis=1), FOLDING.reach)
    assert FOLDING.field_deg[0] == pytest.approx(2 * np.degrees(np.arctan(FOLDING.reach)), abs=0.1)


def test_whatever_the_distortion_a_rig_can_be_checked() -> None:
    """Random terms: the search for a direction runs anywhere, also to where its equations are singular."""
    rng = np.random.default_rng(0)
    other = Camera.looking_at("other", (1280, 720), 640, (4, 0, 1), np.array([0, 0, 1.0]))
    for _ in range(100):
        k1, k2, k3 = rng.uniform((-0.4, -0.2, -0.3), (0.3, 0.4, 0.1))
        found = check_rig(Rig((replace(FOLDING, distortion=np.array([k1, k2, 0, 0, k3])), other)))
        assert np.isfinite([check.distortion_px for check in found.cameras]).all()


def test_a_pixel_without_a_direction_is_no_image_of_a_point() -> None:
    others = [Camera.looking_at(str(x), (1280, 720), 900, (x, -3, 1), np.array([0, 0, 1.0])) for x in (-1.0, 1.0)]
    rig, point = Rig((FOLDING, *others)), np.array([[0.1, 0.2, 1.1]])
    pixels = rig.project(point)
    pixels[0] = 1279, 719
    np.testing.assert_allclose(rig.triangulate(pixels)[0], point, atol=1e-9)
    assert np.isnan(rig.triangulate(pixels[:, :1] * np.array([1, 1, np.nan])[:, None, None])[0]).all()


def test_a_fisheye_lens_ends_where_its_quotient_does(tmp_path: Path) -> None:
    """75 degrees from the axis, which the reader of a rig is told where the image shows more."""
    matrix = np.array([[480.0, 0, 639.5], [0, 480, 359.5], [0, 0, 1]])
    wide = Camera("wide", (1280, 720), matrix, rational_of("wide", (1280, 720), matrix, np.zeros(4)), np.eye(4))
    angles = np.radians([70, 74.9, 75.1, 80])
    pixels = wide.project(np.column_stack([np.tan(angles), np.zeros(4), np.ones(4)]))[:, 0]
    np.testing.assert_allclose(pixels, 639.5 + 480 * np.where(angles < np.radians(75), angles, np.nan), atol=0.1)
    directions = wide.undistort(np.column_stack([639.5 + 480 * angles, np.full(4, 359.5)]))
    np.testing.assert_array_equal(np.isfinite(directions).all(axis=1), [True, True, False, False])
    assert wide.turns_back_px is None
    told = told_end(wide)
    assert told is not None
    assert "75 degrees" in told
    assert "628 px" in told
    save_rig(Rig((wide,)), tmp_path / "rig.toml")
    assert told in read_rig(tmp_path / "rig.toml").remarks
    narrow = replace(wide, matrix=matrix * [[1.5], [1.5], [1]] - [[0, 0, 319.75], [0, 0, 179.75], [0, 0, 0]])
    assert told_end(narrow) is None


def test_pictures_are_made_of_lenses_that_do_not_fill_their_image() -> None:
    assert background_plates(Rig((FOLDING.downscaled(4),)))[0].any(axis=2).all()
    pinhole = pinhole_of(FOLDING, 1)
    assert np.isfinite(pinhole.positions).all()
    assert max(pinhole.size) < 4000
    assert np.isfinite(_camera(FOLDING, np.zeros(4))["sheet"]).all()
