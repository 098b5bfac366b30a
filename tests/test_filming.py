"""Before filming: where cameras see, what they measure, what hides; a recording made with one's own rig."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace

import av
import numpy as np
import pytest
from typer.testing import CliRunner

from tracker.bodies.body.description import load_body
from tracker.bodies.contours import PX_PER_OBSERVATION
from tracker.bodies.scene import Person, Scene
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import load_rig, save_rig
from tracker.foundation.errors import CalibrationError, ConfigError, TrackerError
from tracker.foundation.resources import model_path
from tracker.running.cli import app
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation import prospect, room
from tracker.synthesis.simulation.common_volume import (
    Floor,
    best_place,
    by_segment,
    check_asked,
    floor_seen,
    seen_whole,
    sees,
    sizes,
    visible_shares,
)
from tracker.synthesis.simulation.filming import film, plan
from tracker.synthesis.simulation.movements import poses_of
from tracker.synthesis.simulation.prospect import best_views, covariances, joint_sigmas, view_information, volume_figure
from tracker.synthesis.simulation.room import background_plates, default_rig, room_around
from tracker.synthesis.simulation.sequence import Recipe
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation

BODY = load_body(model_path("gavrila22"))
SMALL = default_rig((320, 256))


def rig_of(*places, target=(5.0, 2.0, 1.0), size=(320, 240), focal=260.0):
    return Rig(
        tuple(Camera.looking_at(f"cam{k}", size, focal, place, np.array(target)) for k, place in enumerate(places))
    )


AROUND = [(5 + 4.5 * np.cos(a), 2 + 4.5 * np.sin(a), 2.0) for a in np.radians([20, 110, 200, 290])]


def scene_and_poses(rig=SMALL, n=4, movement="walk"):
    poses = poses_of(movement, BODY, np.linspace(0, 1.5, n))
    return Scene((Person("a", BODY, poses[0]),), rig), poses


def test_a_point_is_seen_where_its_image_is_and_never_from_behind():
    camera = rig_of((0, 0, 1.0), target=(1, 0, 1.0)).cameras[0]
    assert sees(camera, np.array([3.0, 0, 1]))
    assert not sees(camera, np.array([-3.0, 0, 1]))
    edge = camera.centre + 4 * camera.rays(np.array([[0.5, 100.0], [-0.5, 100.0], [319.5, 3.0]]))
    np.testing.assert_array_equal(sees(camera, edge), [True, False, False])


def test_the_best_place_is_the_middle_of_what_all_see():
    floor = floor_seen(rig_of(*AROUND), 1.75)
    assert floor.whole.max() == 4
    np.testing.assert_allclose(best_place(floor), (5, 2), atol=0.25)
    areas, volumes = ([what(n) for n in (1, 2, 3, 4)] for what in (floor.area_m2, floor.volume_m3))
    assert areas == sorted(areas, reverse=True)
    assert volumes == sorted(volumes, reverse=True)
    assert all(volume >= 1.75 * area for area, volume in zip(areas, volumes, strict=True))


@pytest.mark.parametrize(("away_m", "focal"), [(8.0, 800.0), (20.0, 2200.0)])
def test_cameras_on_one_side_may_look_at_a_place_far_away(away_m, focal):
    rig = rig_of((3, 0, 1.4), (5, 0, 1.4), (7, 0, 1.4), target=(5, away_m, 1), focal=focal)
    floor = floor_seen(rig, 1.8)
    x, y = best_place(floor)
    assert floor.whole.max() == 3
    assert (x, y) == pytest.approx((5, away_m), abs=2.0)
    check_asked(rig, (5, away_m), None)
    assert seen_whole(rig, np.array([[5, away_m], [5, 1.0]]), 1.8).tolist() == [3, 0]


def test_areas_are_those_of_the_cameras_picture():
    """Cells of the floor, one by one, against twelve points around a person."""
    rig = rig_of((0, 0, 2.0), (0, 0.011, 2.0), target=(4, 0, 0.9))
    floor = floor_seen(rig, 1.0)
    x, y = np.meshgrid(floor.x, floor.y)
    marks = [(dx, dy, z) for dx, dy in ((0.35, 0), (-0.35, 0), (0, 0.35), (0, -0.35)) for z in (0.0, 0.5, 1.0)]
    cells = np.random.default_rng(0).permutation(x.size)[:1500]
    for i, j in zip(*np.unravel_index(cells, x.shape), strict=True):
        points = np.array([(x[i, j] + dx, y[i, j] + dy, z) for dx, dy, z in marks])
        assert floor.whole[i, j] == sum(sees(camera, points).all() for camera in rig.cameras)


def test_cameras_that_share_nothing_are_refused():
    apart = Rig(
        (
            Camera.looking_at("a", (320, 240), 300.0, (0, 0, 2), np.array([-3.0, 0, 1])),
            Camera.looking_at("b", (320, 240), 300.0, (1, 0, 2), np.array([4.0, 0, 1])),
        )
    )
    with pytest.raises(CalibrationError, match="no place on the floor is seen by two cameras"):
        plan(Recipe("squat"), apart)
    with pytest.raises(CalibrationError, match='one camera, "a"'):
        plan(Recipe("squat"), apart.select(("a",)))
    with pytest.raises(CalibrationError, match=r'camera "cam1" is 1\.00 m below the floor'):
        plan(Recipe("squat"), rig_of(AROUND[0], (5.0, -3.0, -1.0)))


def test_a_small_body_is_seen_whole_before_cameras_as_near_as_it_is_small():
    rig = rig_of(*(0.12 * np.array(AROUND)), target=(0.6, 0.24, 0.12))
    found = plan(Recipe("squat", stature_m=0.21, seconds=0.2), rig)
    assert found.whole == found.floor.whole.max() == 4
    assert found.place == pytest.approx((0.6, 0.24), abs=0.05)


@pytest.mark.parametrize("heading_deg", [None, 75.0])
def test_the_middle_of_the_way_lies_where_it_is_asked_for(heading_deg):
    found = plan(Recipe("walk", seconds=2.0), rig_of(*AROUND), (4.6, 2.3), heading_deg)
    way = found.poses[:, BODY.root.shifts[:2]]
    turned = np.array([[1, 0], [0, 1]])
    np.testing.assert_allclose((way @ turned).min(axis=0) / 2 + way.max(axis=0) / 2, (4.6, 2.3), atol=0.02)
    ahead = way[-1] - way[0]
    assert np.linalg.norm(ahead) > 1.0
    asked = np.degrees(np.arctan2(ahead[1], ahead[0]))
    assert (asked - found.recipe.heading_deg + 180) % 360 - 180 == pytest.approx(0, abs=5)


def test_the_way_is_laid_where_the_cameras_see_it():
    corridor = rig_of((0, -0.8, 1.8), (0, 0.8, 1.8), target=(4, 0, 0.9), size=(120, 480), focal=400.0)
    found = plan(Recipe("walk", seconds=3.0), corridor)

    def seen(poses):
        points = BODY.landmarks_in_world(poses)
        return np.mean([sees(camera, points).mean() for camera in corridor.cameras])

    others = [seen(plan(Recipe("walk", seconds=3.0), corridor, None, heading).poses) for heading in range(0, 360, 60)]
    assert seen(found.poses) >= max(others) - 0.01
    assert seen(found.poses) > min(others) + 0.05


def test_information_is_that_of_contours_moved_by_the_pose():
    """Against finite differences: points that stay on the body, moved across their contour."""
    scene, poses = scene_and_poses(n=1)
    q, edge_px, step = poses[0], 0.7, 1e-6
    traced = CpuSynthesis().contours(scene, 0, poses)
    found = view_information(scene, poses, CpuSynthesis(), edge_px)[0]
    for v, camera in enumerate(scene.rig.cameras[:2]):
        n = int(traced.counts[0, v])
        points, samples = traced.points[0, v, :n].astype(float), traced.positions[0, v, :n].astype(float)
        parts = traced.parts[0, v, :n]
        local = np.linalg.inv(BODY.world_from_part(q))[parts] @ np.append(points, np.ones((n, 1)), axis=1)[..., None]
        rows = np.zeros((n, BODY.dof))
        for k in range(BODY.dof):
            images = []
            for sign in (1, -1):
                moved = q.copy()
                moved[k] += sign * step
                images.append(camera.project((BODY.world_from_part(moved)[parts] @ local)[:, :3, 0]))
            rows[:, k] = ((images[0] - images[1]) / (2 * step) * samples[:, 2:4]).sum(axis=1)
        expected = (rows * samples[:, 4:5]).T @ rows / PX_PER_OBSERVATION / edge_px**2
        np.testing.assert_allclose(found[v], expected, rtol=1e-4, atol=1e-3 * np.abs(expected).max())


def test_the_prior_is_that_of_the_estimation():
    assert TwistIcpEstimation(prior_deg=prospect.PRIOR_DEG, prior_m=prospect.PRIOR_M) == TwistIcpEstimation()


def test_a_view_less_is_never_better_and_the_best_views_are_the_best():
    scene, poses = scene_and_poses()
    information = view_information(scene, poses, CpuSynthesis(), 1.0)

    def error(views):
        return float(np.sqrt(np.mean(joint_sigmas(BODY, poses, covariances(BODY, information, views)) ** 2)))

    best = best_views(BODY, poses, information)
    assert set(best) == {2, 3, 4}
    errors = [error(best[n]) for n in (2, 3, 4)]
    assert errors == sorted(errors, reverse=True)
    assert errors[1] == min(error(tuple(set(range(4)) - {v})) for v in range(4))
    assert error(()) > 10 * errors[0]
    np.testing.assert_allclose(covariances(BODY, information, (0, 1)), covariances(BODY, information, (1, 0)))


def test_of_thirty_cameras_not_all_subsets_are_made(monkeypatch):
    """There are 155 million of fifteen of them."""
    poses = poses_of("walk", BODY, np.zeros(1))
    information = 1e4 * np.linspace(1, 2, 30)[None, :, None, None] * np.eye(BODY.dof)

    def few(views, n):
        assert math.comb(len(views), n) < 1000
        return itertools.combinations(views, n)

    monkeypatch.setattr(prospect, "combinations", few)
    assert best_views(BODY, poses, information) == {n: tuple(range(30 - n, 30)) for n in range(2, 31)}


def test_sigmas_of_joints_are_those_of_scattered_poses():
    scene, poses = scene_and_poses(n=1)
    covariance = covariances(BODY, view_information(scene, poses, CpuSynthesis(), 0.3), range(4))
    rng = np.random.default_rng(0)
    scattered = rng.multivariate_normal(poses[0], covariance[0], 4000)
    gaps = BODY.landmarks_in_world(scattered) - BODY.landmarks_in_world(poses[0])
    measured = np.sqrt((gaps**2).sum(axis=-1).mean(axis=0))
    np.testing.assert_allclose(joint_sigmas(BODY, poses, covariance)[0], measured, rtol=0.06)


def test_what_is_behind_the_trunk_or_outside_is_not_seen():
    left = Camera.looking_at("left", (320, 256), 250.0, (0, 4, 1.0), np.array([0, 0, 1.0]))
    away = Camera.looking_at("away", (320, 256), 250.0, (0, -4, 1.0), np.array([0, -9, 1.0]))
    feet = Camera.looking_at("feet", (320, 100), 500.0, (4, 0, 0.3), np.array([0, 0, 0.3]))
    scene, poses = scene_and_poses(Rig((left, away, feet)), n=1, movement="squat")
    shares = visible_shares(scene, poses, CpuSynthesis())
    assert shares.min() >= 0
    assert shares.max() <= 1
    found = {name: values[0] for name, values in by_segment(BODY, shares).items()}
    assert found["left_upper_arm"][0] > 0.4  # half of an upper arm's surface faces the trunk or is in the shoulder
    assert found["right_upper_arm"][0] < 0.1
    assert all(values[1] == 0 for values in found.values())
    assert found["left_shin"][2] > 0.6
    assert found["left_upper_arm"][2] == 0


def test_pictures_do_not_depend_on_how_many_rows_are_cast_at_once(monkeypatch):
    rig = Rig(default_rig((60, 50)).cameras[:1])
    (whole,) = background_plates(rig)
    monkeypatch.setattr(room, "_ROWS", 7)
    other = background_plates(rig)[0] != whole
    # a ray at the border of two squares of a texture meets one or the other as it is rounded
    assert other.mean() < 0.001


def test_a_room_holds_the_cameras_and_what_they_film():
    far = rig_of((25, 2, 3.8), (-6, 9, 1.0), size=(64, 48))
    around = room_around(far, (5, 2))
    for camera in far.cameras:
        assert (np.abs(camera.centre[:2] - around.centre) < np.array(around.half) - 1).all()
        assert camera.centre[2] < around.height
    assert 2 * max(around.half) * around.texel <= 3001
    for plate in background_plates(far, 0, around):
        assert plate.std() > 5
    near = room_around(default_rig(), (0, 0))
    np.testing.assert_allclose(near.half, room.Room().half, atol=0.6)


def test_the_picture_shows_the_person_also_before_cameras_in_line():
    line = rig_of((4.2, 0, 1.4), (5, 0, 1.4), (5.8, 0, 1.4), target=(5, 4.5, 1))
    poses = poses_of("walk", BODY, np.linspace(0, 1, 3), place=(5, 4.5))
    x, y = np.arange(-1.0, 12.0), np.arange(-6.0, 7.0)
    seen = np.add.outer(y > 2, x > 3).astype(int)
    floor = Floor(x, y, np.linspace(0, 1.8, 4), seen, np.stack([seen] * 4))
    plan_of, space = volume_figure(line, floor, BODY, poses, "walk").axes[:2]
    shown = np.concatenate([poses[:, BODY.root.shifts[:2]], [camera.centre[:2] for camera in line.cameras]])
    for axes in (plan_of, space):
        low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
        assert ((low < shown) & (shown < high)).all()


def test_a_recording_is_made_with_cameras_of_any_size(tmp_path):
    cameras = rig_of(*AROUND[:2]).cameras
    odd = replace(cameras[1], name="odd", size=(317, 201))
    planned = plan(Recipe("squat", seconds=0.08, stature_m=1.6), Rig((cameras[0], odd)))
    config = film(planned, planned.prospect(1.0), tmp_path / "out")
    sizes = {}
    for name in ("cam0", "odd"):
        with av.open(str(config.parent / f"{name}.mp4")) as video:
            stream = video.streams.video[0]
            sizes[name] = (stream.width, stream.height)
    assert sizes == {"cam0": (320, 240), "odd": (317, 201)}
    np.testing.assert_array_equal(load_rig(config.parent / "rig.toml").sizes, [(320, 240), (317, 201)])
    body = load_body(config.parent / "model.toml")
    height = np.ptp(body.landmarks_in_world(body.rest())[:, 2])
    usual = np.ptp(BODY.landmarks_in_world(BODY.rest())[:, 2])
    assert height / usual == pytest.approx(1.6 / 1.8)
    with pytest.raises(ConfigError, match="not empty"):
        film(planned, planned.prospect(1.0), tmp_path / "out")


def told(*arguments):
    done = CliRunner().invoke(app, ["simulate", *map(str, arguments)])
    if isinstance(done.exception, TrackerError):
        return str(done.exception)
    assert done.exit_code == 0, (done.output, done.exception)
    return done.output


def test_the_command_tells_what_to_expect_and_tracks(tmp_path):
    save_rig(SMALL, tmp_path / "rig.qca.txt")
    output = tmp_path / "out"
    asked = "--rig", tmp_path / "rig.qca.txt", "--movement", "squat", "--person", 1.7, "--seconds", 0.2
    printed = " ".join(told(*asked, "--output", output).split())
    for word in ("4 of 4 cameras see", "left wrist", "without FRONT", "hidden", "tracked: 0 of 5 frames lost"):
        assert word in printed
    content = json.loads((output / "prospect.json").read_text())
    assert set(content["joints_sigma_mm"]) == set(BODY.landmark_names)
    assert 0 < content["all_views"]["sigma_mm"] < content["without"]["FRONT"]["sigma_mm"] < 100
    assert set(content["visible"]["torso"]) == set(SMALL.names)
    assert content["enough"] in (2, 3, 4)
    assert (output / "volume.png").read_bytes().startswith(b"\x89PNG")
    for name in ("run.toml", "FRONT.mp4", "truth_joints.csv", "tracking/evaluation.json", "tracking/poses.csv"):
        assert (output / name).is_file()
    assert "not empty" in told(*asked, "--output", output)


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (("--movement", "wlak"), 'no movement "wlak" of model "gavrila22"; did you mean "walk"'),
        (("--person", 5, "--movement", "wlak"), 'no movement "wlak"'),
        (("--person", 0.04, "--movement", "wlak"), 'no movement "wlak"'),
        (("--model", "hunam"), 'no body model "hunam"; did you mean "human"'),
        (("--model", "quadruped"), 'no movement "walk" of model "quadruped"; valid: bow, trot'),
        (("--size", "big"), "--size big: expected for instance 1920x1080"),
    ],
)
def test_mistakes_are_one_line_and_nothing_is_written(tmp_path, arguments, fault):
    save_rig(SMALL, tmp_path / "rig.toml")
    assert fault in told("--rig", tmp_path / "rig.toml", "--output", tmp_path / "out", *arguments)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["rig.toml"]


def test_a_missing_rig_is_named(tmp_path):
    assert "no such file" in told("--rig", tmp_path / "none.toml")


def test_floors_of_small_bodies_are_told_in_digits_that_say_something() -> None:
    assert sizes({2: 12.345, 3: 1.0, 4: 0.0}, "m2") == "2 or more: 12.3 m2, 3 or more: 1.0 m2, 4 or more: 0.0 m2"
    assert sizes({2: 0.519, 3: 0.0021}, "m³") == "2 or more: 0.52 m³, 3 or more: 0.0021 m³"
