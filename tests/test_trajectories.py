"""Motion of followed points and the filters of their trajectories: parabolas, seeded jumps, a turning body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tracker.cameras.camera import Camera
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.points.following.births import surroundings
from tracker.points.following.filters import TrajectoryFilters, cut_where_false, no_cuts
from tracker.points.following.following import Following
from tracker.points.following.record import motion_of, sighting_type, trajectories_of, windows
from tracker.points.following.report import Course, points_picture, summarized
from tracker.points.following.snakes import Snake
from tracker.points.surfaces.surface import Preparation
from tracker.points.trajectories import PointStatus
from tracker.running.jobs._following import SecondLook, TrajectoryFiles

N_FRAMES, N_POINTS, FPS, NOISE_M = 40, 1600, 50.0, 3e-4


def trajectories(positions, sigma=NOISE_M):
    times = np.arange(len(positions)) / FPS
    return trajectories_of(sightings(positions, sigma), np.arange(len(positions)), times)


def sightings(positions, sigma=NOISE_M):
    t, n = np.nonzero(np.isfinite(positions[..., 0]))
    rows = np.zeros(len(t), dtype=sighting_type(2))
    rows["frame"], rows["id"], rows["status"] = t, n, PointStatus.FOLLOWED
    rows["position"], rows["covariance"] = positions[t, n], sigma**2 * np.eye(3)
    return rows


def cut(positions, **settings):
    rows, n_frames = sightings(positions), len(positions)
    frames, times = np.arange(n_frames), np.arange(n_frames) / FPS
    cuts = cut_where_false(TrajectoryFilters(), rows, frames, times, **settings)
    return cuts, trajectories_of(cuts.relabelled(rows), frames, times)


@pytest.fixture(scope="module")
def turning():
    """A back of 0.4 m that turns at 3 rad/s, moves at 1 m/s and brakes, measured to 0.3 mm."""
    rng = np.random.default_rng(0)
    rest = rng.uniform((-0.2, -0.02, -0.2), (0.2, 0.02, 0.2), (N_POINTS, 3))
    times = np.arange(N_FRAMES) / FPS
    places = [Rotation.from_euler("z", 3 * t).apply(rest) + np.array((t - 2 * t * t, 0, 0)) for t in times]
    return trajectories(np.array(places) + rng.normal(scale=NOISE_M, size=(N_FRAMES, N_POINTS, 3)))


def test_velocity_and_acceleration_of_a_parabola_are_exact():
    times = np.arange(10)[:, None, None] / FPS
    velocity, acceleration = np.array([[[1.0, -2.0, 0.5]]]), np.array([[[3.0, 9.0, -4.0]]])
    made = trajectories(velocity * times + 0.5 * acceleration * times**2 + 1.0)
    motion = motion_of(made)
    np.testing.assert_allclose(motion.velocities, velocity + acceleration * times, atol=1e-9)
    np.testing.assert_allclose(motion.accelerations, np.broadcast_to(acceleration, (10, 1, 3)), atol=1e-7)


def test_sigmas_of_motion_are_those_of_its_noise(turning):
    motion = motion_of(turning)
    still = replace(turning, positions=np.random.default_rng(1).normal(scale=NOISE_M, size=(N_FRAMES, N_POINTS, 3)))
    found = motion_of(still)
    inner = slice(2, -2)
    for values, sigmas in (
        (found.velocities, found.velocity_sigmas),
        (found.accelerations, found.acceleration_sigmas),
    ):
        assert np.sqrt(np.mean((values[inner] / sigmas[inner]) ** 2)) == pytest.approx(1.0, abs=0.03)
    centre = motion.velocities.mean(axis=1)
    np.testing.assert_allclose(centre[inner, 0], (1 - 4 * turning.times)[inner], atol=0.1)


def test_no_motion_is_told_across_a_gap():
    positions = np.cumsum(np.ones((12, 1, 3)), axis=0)
    positions[5] = np.nan
    motion = motion_of(trajectories(positions))
    known = np.isfinite(motion.velocities[:, 0, 0])
    np.testing.assert_array_equal(np.flatnonzero(~known), [4, 5, 6])
    np.testing.assert_allclose(motion.velocities[known], FPS, rtol=1e-9)


def jumping(turning):
    """Positions with jumps seeded, of which points, in which frames."""
    rng = np.random.default_rng(2)
    # cubes at the border hold too few points to judge by
    inner = np.flatnonzero((np.abs(turning.positions[0][:, [0, 2]]) < 0.15).all(axis=1))
    jumped, at = rng.choice(inner, 40, replace=False), rng.integers(6, N_FRAMES - 6, 40)
    positions = turning.positions.copy()
    for n, t in zip(jumped, at, strict=True):
        direction = rng.normal(size=3)
        # from 8 mm, which is 0.4 m/s, to 60 mm
        positions[t:, n] += direction / np.linalg.norm(direction) * rng.uniform(0.008, 0.06)
    return positions, jumped, at


def test_the_filters_leave_a_turning_body_alone(turning):
    cuts, after = cut(turning.positions)
    assert (cuts.n_fast, cuts.n_unlike, cuts.n_removed) == (0, 0, 0)
    np.testing.assert_array_equal(after.ids, turning.ids)
    np.testing.assert_array_equal(after.positions, turning.positions)


def test_seeded_jumps_split_trajectories_and_nothing_else(turning):
    positions, jumped, at = jumping(turning)
    cuts, after = cut(positions)
    assert cuts.n_fast + cuts.n_unlike == 40
    assert len(after.ids) == N_POINTS + 40
    assert len(set(after.ids)) == len(after.ids)
    parents = np.array([cuts.parents[number] for number in after.ids])
    for n, t in zip(jumped, at, strict=True):
        first, second = np.flatnonzero(parents == n)
        np.testing.assert_array_equal(after.seen[:, first], np.arange(N_FRAMES) < t)
        np.testing.assert_array_equal(after.seen[:, second], np.arange(N_FRAMES) >= t)
        assert after.ids[first] == n
        assert after.ids[second] >= N_POINTS


def test_short_pieces_are_cut_off(turning):
    positions = turning.positions.copy()
    positions[-2:, 7] += 0.05
    positions[2:, 9] = np.nan
    cuts, after = cut(positions)
    assert 9 not in after.ids
    assert cuts.n_removed == 1
    own = [number for number in after.ids if cuts.parents[number] == 7]
    assert len(own) == 1
    assert after.seen[:, after.ids == own[0]].sum() == N_FRAMES - 2


def test_a_step_that_no_body_makes_is_fast(turning):
    positions = turning.positions.copy()
    positions[20:, 3] += 0.5
    assert cut(positions)[0].n_fast == 1


def test_windows_of_a_record_tell_what_the_whole_tells(turning):
    positions, *_ = jumping(turning)
    cuts, after = cut(positions)
    parts, _ = cut(positions, most_sightings=1)
    for name in ("false", "pieces", "ids", "n_seen"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(cuts, name))
    whole, n_windows = motion_of(after), 0
    record = sightings(positions), np.arange(N_FRAMES), np.arange(N_FRAMES) / FPS
    for window in windows(*record, 4, cuts.relabelled, most_sightings=1):
        own, motion = window.trajectories, motion_of(window.trajectories)
        columns = np.searchsorted(after.ids, own.ids)
        numbers = own.frames[window.inner]
        np.testing.assert_array_equal(own.positions[window.inner], after.positions[numbers][:, columns])
        found, expected = motion.velocities[window.inner], whole.velocities[numbers][:, columns]
        np.testing.assert_allclose(found, expected, atol=1e-9)
        assert len(own.frames) < N_FRAMES
        n_windows += 1
    assert n_windows == 2


def test_the_points_seen_longest_are_chosen_and_the_named_ones(turning):
    positions = turning.positions.copy()
    positions[10:, 100:] = np.nan
    cuts, _ = cut(positions)
    np.testing.assert_array_equal(cuts.longest(np.array([500, 700]), 52), [*range(50), 500, 700])


def test_a_recording_too_short_for_any_trajectory_is_told_and_written(turning, tmp_path):
    record = sightings(turning.positions[:2, :9]), np.arange(2), np.arange(2) / FPS
    cuts = cut_where_false(TrajectoryFilters(), *record)
    asked = []

    def around(ids, positions):
        asked.append((ids, positions))
        return surroundings(ids, positions, ("knee",), positions[:1], 1.0)

    TrajectoryFiles(("left", "right"), {}, around, 1, 500, c3d=False).write(tmp_path, record, cuts)
    assert (tmp_path / "trajectories.csv").read_text().count("\n") == 1
    assert (tmp_path / "trajectories.trc").read_text().splitlines()[2].split("\t")[2:4] == ["2", "0"]
    np.testing.assert_array_equal(asked[0][1], turning.positions[0, :9])
    told = summarized(record[0], record[1], cuts, Course(1.0, interrupted=False, warnings=())).warnings
    assert told == ("all 9 trajectories are seen in too few frames, and removed: filters.min_frames",)


def test_a_frame_without_any_image_has_no_picture(tmp_path):
    rig = Rig((Camera.looking_at("one", (100, 80), 100, (0, -1, 0), np.zeros(3)),))
    look = SecondLook(Snake(), {}, rig, Following(), Preparation(), picture_frames=1)
    rows, grey = np.zeros(0, dtype=sighting_type(1)), np.full((80, 100, 3), 90, np.uint8)
    frames = (Frame(t, t / FPS, (None if t == 1 else grey,)) for t in range(3))
    (tmp_path / "points_000009.jpg").touch()
    look.take(tmp_path, frames, (rows, np.arange(3)), no_cuts(rows))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["points_000000.jpg", "points_000002.jpg"]


def test_views_of_any_height_are_shown_whole():
    rows = np.zeros(1, dtype=sighting_type(2))
    rows["status"], rows["pixels"] = PointStatus.BORN, ((40, 30), (40, 130))
    picture = points_picture(tuple(np.full((height, 100, 3), 90, np.uint8) for height in (60, 140)), rows, 0)
    assert picture.shape == (980, 1400, 3)
    assert (picture[910, 700 + 280] == 255).all()
