"""Rooms filmed from elsewhere, with longer lenses, and with furniture before the person."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recordings import small_simulation

from tracker.images.plate import Plate
from tracker.synthesis.simulation.sequence import Simulation

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))

from benchmarks.furniture import Box, chair, cupboards, furnished
from benchmarks.rooms import Standpoint, filmed_with, placed, turned_cameras


@pytest.fixture(scope="module")
def filmed() -> Simulation:
    return small_simulation(n_frames=3)


def test_a_longer_lens_shows_the_same_larger(filmed):
    camera, picture = filmed.scene.rig.cameras[0], filmed.plates[0].picture
    near, larger = filmed_with(camera, picture, 1, 1.6)
    middle = (np.array(camera.size) - 1) / 2
    points = np.random.default_rng(0).uniform((-1, -1, 0), (1, 1, 2), (20, 3))
    np.testing.assert_allclose(near.project(points) - middle, 1.6 * (camera.project(points) - middle), atol=1e-9)
    assert larger.shape == picture.shape
    small, half = filmed_with(camera, picture, 2, 1.0)
    assert half.shape[:2] == (picture.shape[0] // 2, picture.shape[1] // 2)
    assert small.downscale == 1


def test_a_cupboard_stands_before_the_person_in_its_view_and_behind_her_in_the_opposite_one(filmed):
    rig, places = filmed.scene.rig, np.zeros((3, 2))
    pictures, away_m = furnished([plate.picture for plate in filmed.plates], rig, cupboards(rig, 1, places))
    hips = np.array([[0.0, 0.0, 1.0]])
    here, opposite = (rig.names.index(name) for name in (rig.names[0], "BACK"))
    assert np.isfinite(away_m[here]).any()
    assert away_m[here].min() < rig.cameras[here].in_camera(hips)[0, 2] - 0.5
    assert away_m[opposite].min() > rig.cameras[opposite].in_camera(hips)[0, 2] + 0.5, "there it stands behind her"
    feet = rig.cameras[0].project(np.array([0.0, 0.0, 0.05])).round().astype(int)
    assert np.isfinite(away_m[0][feet[1], feet[0]])
    head = rig.cameras[0].project(np.array([0.0, 0.0, 1.75])).round().astype(int)
    assert np.isinf(away_m[0][head[1], head[0]])
    assert np.any(pictures[0] != filmed.plates[0].picture)
    assert furnished([plate.picture for plate in filmed.plates], rig, [])[1] == ()


def test_what_stands_in_front_is_seen_in_front(filmed):
    boxes = cupboards(filmed.scene.rig, 1, np.zeros((3, 2)))
    pictures, away_m = furnished([plate.picture for plate in filmed.plates], filmed.scene.rig, boxes)
    shown = [np.isfinite(one) for one in away_m]

    hidden = replace(filmed, plates=tuple(map(Plate, pictures)), away_m=away_m)
    stood = replace(hidden, away_m=())
    still, open_ = next(iter(hidden.frames())).images[0], next(iter(stood.frames())).images[0]
    assert still is not None
    assert open_ is not None
    away = np.abs(still.astype(int) - pictures[0].astype(int)).max(axis=2)
    assert np.percentile(away[shown[0]], 99) < 30
    assert np.abs(open_.astype(int) - pictures[0].astype(int)).max(axis=2)[shown[0]].max() > 60

    back = filmed.scene.rig.names.index("BACK")
    last, free = next(iter(hidden.frames())).images[back], next(iter(stood.frames())).images[back]
    np.testing.assert_array_equal(last, free, "it stands behind her: nothing of her is hidden there")


def test_depths_of_boxes_are_where_rays_meet_them(filmed):
    rig = filmed.scene.rig
    seat = Box((0.2, -0.1, 0.5), 0.4, 0.5, 0.6, 0.3)
    _, away_m = furnished([plate.picture for plate in filmed.plates], rig, [seat])
    turn = np.array([[np.cos(0.4), -np.sin(0.4), 0], [np.sin(0.4), np.cos(0.4), 0], [0, 0, 1]])
    for camera, away in zip(rig.cameras, away_m, strict=True):
        rows, columns = np.nonzero(np.isfinite(away))
        assert len(rows) > 50
        pixels = np.stack([columns, rows], axis=1).astype(np.float64)
        ways = camera.rays(pixels) @ turn
        # slabs: the last of the three entries is where the ray enters the box
        start = (camera.centre - (0.2, -0.1, 0.5)) @ turn
        halves = np.array([0.25, 0.3, 0.15])
        entries = np.minimum((-halves - start) / ways, (halves - start) / ways).max(axis=1)
        points = camera.centre + entries[:, None] * camera.rays(pixels)
        np.testing.assert_allclose(camera.in_camera(points)[:, 2], away[rows, columns], rtol=2e-3)


def test_the_seat_of_a_chair_is_below_who_sits_and_its_back_behind():
    boxes = chair(np.array([1.0, 2.0]), np.pi / 2, 0.45)
    corners = np.concatenate([box.mesh.vertices for box in boxes])
    assert corners[:, 2].min() == pytest.approx(0, abs=1e-9)
    seat, backrest = boxes[-2], boxes[-1]
    assert seat.mesh.vertices[:, 2].max() == pytest.approx(0.45)
    assert backrest.mesh.vertices[:, 1].max() < 2.0 - 0.2
    assert np.ptp(backrest.mesh.vertices[:, 0]) == pytest.approx(0.44)


def test_cameras_are_turned_by_as_much_as_is_asked(filmed):
    for before, after in zip(filmed.scene.rig.cameras, turned_cameras(filmed.scene.rig, 0.2).cameras, strict=True):
        turn = after.camera_from_world[:3, :3] @ before.camera_from_world[:3, :3].T
        np.testing.assert_allclose(np.degrees(np.arccos((np.trace(turn) - 1) / 2)), 0.2, rtol=1e-6)
        np.testing.assert_allclose(after.centre, before.centre, atol=1e-9)


def test_cameras_stand_where_they_are_told_and_look_upright_at_the_middle(filmed):
    room = filmed.scene.rig
    told = (Standpoint(0, 0.6), Standpoint(30, 1.5, 4.0), *[Standpoint(60 * k, 2.0) for k in range(2, 5)])
    rig, pictures = placed(room, [plate.picture for plate in filmed.plates], told)
    ways = np.array([camera.centre[:2] for camera in (room.cameras[0], *rig.cameras)]) - room.middle[:2]
    azimuths = np.degrees(np.arctan2(ways[:, 1], ways[:, 0]))
    np.testing.assert_allclose((azimuths[1:] - azimuths[0]) % 360, [one.azimuth_deg for one in told], atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(ways[1:], axis=1), [one.away_m for one in told])
    np.testing.assert_allclose([camera.centre[2] for camera in rig.cameras], [one.height_m for one in told])
    for camera in rig.cameras:
        low, high = camera.in_camera(np.array([[*room.middle[:2], 1.0], [*room.middle[:2], 1.4]]))
        np.testing.assert_allclose(low[:2], 0, atol=1e-9)
        assert abs(high[0]) < 1e-9
        assert high[1] < 0  # up in the image
    assert rig.names == ("C1", "C2", "C3", "C4", "C5")
    assert np.array_equal(pictures[4], filmed.plates[0].picture[:, ::-1])
