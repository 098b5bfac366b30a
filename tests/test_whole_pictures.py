"""Contours and pictures of parts are whole: where there is little room, far off the axis, and against ray casting."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pydantic
import pytest
from observations import ideal
from painted import RULE, encoded, looks_of, scattered_tables
from rig_samples import FISHEYE
from solids import LENS, MIDDLE, MODELS, RIGS, camera_at, least, posed, solid, thing

from tracker.bodies.scene import Scene
from tracker.bodies.segments import Part, TaperedSuperquadric
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Mask
from tracker.kernels.contours import MOST_COLUMNS, MOST_ROWS
from tracker.kernels.regions import Lines
from tracker.synthesis import cpu
from tracker.synthesis._pictures import distances_of, misfits_of, rasterized_ids
from tracker.synthesis.cpu import FINEST, CpuSynthesis
from tracker.synthesis.osmesa import pinhole_of


def ray_cast_silhouette(scene: Scene, camera: Camera) -> tuple[Mask, Mask]:
    """Which pixels see a part clearly, and which see one at all, by ray casting."""
    columns, rows = np.meshgrid(np.arange(camera.size[0]), np.arange(camera.size[1]))
    far = camera.centre + 12 * camera.rays(np.stack([columns, rows], axis=-1).reshape(-1, 2))
    inverses = np.linalg.inv(scene.world_from_parts()[0])
    values = [least(s, m, camera.centre, far, 60) for s, m in zip(scene.shapes, inverses, strict=True)]
    inside = (np.min(values, axis=0) < 1).reshape(camera.size[::-1])
    return cv2.erode(inside.astype(np.uint8), np.ones((3, 3))) > 0, cv2.dilate(
        inside.astype(np.uint8), np.ones((3, 3))
    ) > 0


def test_a_long_contour_is_scored_as_a_whole() -> None:
    """Samples are as dense as the smallest view needs: a ball alone has 240 of them in one ten times as large."""
    small, large = (Camera.looking_at(str(s), (s, s), 1.3 * s, (2.0, 0.1 * s, 1.0), MIDDLE) for s in (90, 900))
    large = replace(large, camera_from_world=camera_at((2.0, 0.3, 1.2)).camera_from_world)
    ball = Part("ball", "ball", 0, TaperedSuperquadric(np.full(3, 0.2), np.ones(2), np.zeros(2)), np.eye(4))
    ball.model_from_part[:3, 3] = MIDDLE
    scene, synthesis, poses = Scene((thing(ball),), Rig((small, large))), CpuSynthesis(), np.array([[0.0], [0.05]])
    drawn, placements = synthesis.contours(scene, 0, poses, coarse=True), scene.world_from_parts(0, poses)
    assert drawn.counts.max() > 128
    observation = ideal(scene)
    found = synthesis.directed_distances(scene, 0, poses, observation, 40.0, False)
    np.testing.assert_allclose(found, distances_of(drawn, observation, 40.0, False), rtol=1e-6)
    images = tuple(np.random.default_rng(1).integers(0, 256, (s, s, 3), dtype=np.uint8) for s in (90, 900))
    looks = looks_of(scattered_tables(2, 1), np.array([0.2]))
    lines = Lines(encoded(images), looks, np.ones(1, dtype=np.bool_), RULE)
    misfits = synthesis.region_misfits(scene, 0, poses, lines)
    np.testing.assert_allclose(misfits, misfits_of(scene, placements, drawn, lines), rtol=1e-6)


def test_a_contour_that_ends_at_the_border_is_whole_where_there_is_little_room_at_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Samples traced inside the image and placed outside of it leave room where others were dropped."""
    synthesis = CpuSynthesis(step_px=2.0)
    for seed in (66, 101):
        (person,) = posed("gavrila22", 1, seed)
        camera = Camera.looking_at("near", (1920, 1080), 2000.0, (2.6, 0.3, 1.4), np.array([0.0, 0.5, 0.8]))
        scene = Scene((person,), Rig((replace(camera, distortion=np.array([*LENS, 0, 0, 0])),)))
        counts = []
        for room in (64, 1024):
            monkeypatch.setattr(cpu, "_SAMPLES_PER_PART", room)
            cpu._TRACED.clear()
            counts.append(int(synthesis.contours(scene).counts[0, 0]))
        assert counts[0] == counts[1] > 64 * len(scene.shapes)


@pytest.mark.parametrize(("lens", "width"), [(FISHEYE, 720), (FISHEYE, 2560), ((0.0,) * 5, 5000)])
def test_a_pinhole_view_has_all_that_a_lens_shows(lens: tuple[float, ...], width: int) -> None:
    camera = Camera.looking_at("strip", (width, 40), 0.46 * width, (2.1, 0.3, 1.8), MIDDLE)
    camera = replace(camera, distortion=np.array(lens))
    view, across = pinhole_of(camera, 2), np.arange(width)
    plane = camera.undistort(np.stack([across, np.full(width, 20.0)], axis=-1))
    assert np.isfinite(plane).all()
    assert ((view.positions > -0.51) & (view.positions < np.array(view.size) - 0.49)).all()
    fx, fy, cx, cy = view.intrinsics
    np.testing.assert_allclose(view.positions[20], plane * (fx, fy) + (cx, cy), atol=1e-6)
    assert fx > 1.5 * camera.matrix[0, 0] or max(view.size) > 4096


def test_the_finest_grid_has_room_for_a_whole_contour() -> None:
    scene = Scene((thing(solid("cone", np.random.default_rng(1), 0.3)),), RIGS["distorted"])
    usual, finest = CpuSynthesis(), CpuSynthesis(n_eta=MOST_ROWS, n_omega=MOST_COLUMNS)
    for v in range(2):
        one, other = (synthesis.contours(scene).of(v).weights.sum() for synthesis in (usual, finest))
        assert one == pytest.approx(other, rel=0.02)
    with pytest.raises(pydantic.ValidationError, match="n_eta"):
        CpuSynthesis(n_eta=1000)


def test_nothing_is_cut_off_a_picture_far_off_the_axis() -> None:
    shape = TaperedSuperquadric(np.array([0.1, 0.1, 0.3]), np.array([0.3, 1.0]), np.zeros(2))
    placement = np.eye(4)
    placement[:3, 3] = 2.8, 0.0, 1.0
    camera = Camera.looking_at("wide", (1280, 720), 500.0, (0.0, -2.5, 1.0), MIDDLE)
    scene = Scene((thing(Part("rod", "rod", 0, shape, placement)),), Rig((camera,)))
    (mask,), (ids,) = CpuSynthesis().silhouettes(scene), rasterized_ids(scene, *FINEST)
    assert mask.sum() > 5000
    assert np.count_nonzero(mask != (ids >= 0)) <= 2


@pytest.mark.parametrize("name", MODELS)
def test_silhouettes_are_those_of_ray_casting(name: str) -> None:
    rig = RIGS["distorted"].downscaled(3)
    for person in posed(name, 2):
        scene = Scene((person,), rig)
        for mask, camera in zip(CpuSynthesis().silhouettes(scene), rig.cameras, strict=True):
            certain, possible = ray_cast_silhouette(scene, camera)
            assert certain.sum() > 300
            assert mask[certain].all()
            assert not mask[~possible].any()


@pytest.mark.parametrize("name", MODELS)
def test_silhouettes_are_the_pixels_of_all_parts(name: str) -> None:
    """Row by row between the outermost lines, or triangle by triangle into a depth buffer: the same to the pixel."""
    for person in posed(name, 2):
        scene, synthesis = Scene((person,), RIGS["distorted"]), CpuSynthesis()
        for mask, ids in zip(synthesis.silhouettes(scene), synthesis.part_ids(scene), strict=True):
            assert np.count_nonzero(mask != (ids >= 0)) <= 2
            assert mask.sum() > 2000


@pytest.mark.parametrize(("gap_m", "is_shown"), [(0.02, False), (0.04, False), (0.06, True)])
def test_what_is_all_but_at_a_camera_is_in_no_picture(gap_m: float, is_shown: bool) -> None:
    camera = Camera.looking_at("near", (360, 288), 400.0, (0.0, -1.0, 1.0), MIDDLE)
    ball = Part("ball", "ball", 0, TaperedSuperquadric(np.full(3, 0.1), np.ones(2), np.zeros(2)), np.eye(4))
    ball.model_from_part[:3, 3] = 0.0, -0.9 + gap_m, 1.0
    scene = Scene((thing(ball),), Rig((camera,)))
    (mask,), (ids,) = CpuSynthesis().silhouettes(scene), CpuSynthesis().part_ids(scene)
    assert mask.any() == is_shown
    np.testing.assert_array_equal(mask, ids >= 0)
