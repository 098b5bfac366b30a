"""Views against each other: delays by parts of a frame and turned cameras are found, and told where they matter."""

from __future__ import annotations

import functools
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from doubted import in_doubt
from motions import estimate_of
from recordings import small_simulation

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.results.alignment import ViewAlignment
from tracker.results.alignment._equations import by_turn, without_common_motion
from tracker.results.alignment.adjustment import FEWEST, align, in_step, turned
from tracker.results.alignment.moments import MOST_MOMENTS, Tracked, chosen_moments, moments_of, rates_of
from tracker.running.aligned_result import described
from tracker.running.jobs._record import compared_views
from tracker.synthesis.simulation.movements import poses_of
from tracker.synthesis.simulation.sequence import Recipe, simulate
from tracker.tracking.initialization._person_sized import enlarged

FPS = 12.5
LONGEST = 40
"""Frames of the longest recording in step, of which shorter ones are the first frames."""

DELAYS_S = 0.0, 0.024, -0.016, 0.036
TURNS = np.radians([[0.0, 0.0, 0.0], [0.2, 0.2, 0.0], [0.0, -0.3, 0.1], [-0.2, 0.1, 0.0]])


@functools.cache
def simulated(n_frames=30):
    return simulate(Recipe("walking_on_the_spot", seconds=n_frames / FPS, fps=FPS))


@functools.cache
def recorded(delays_s=(0.0, 0.0, 0.0, 0.0), n_frames=30):
    """A person who walks, seen by each view so much later, and the images, once for all tests."""
    if not any(delays_s) and n_frames < LONGEST:
        return simulated(n_frames), recorded(n_frames=LONGEST)[1][:n_frames]
    simulation, views = simulated(n_frames), []
    for v, (name, delay_s) in enumerate(zip(simulation.scene.rig.names, delays_s, strict=True)):
        alone = Scene(simulation.scene.persons, simulation.scene.rig.select((name,)))
        seen = replace(
            simulation, scene=alone, plates=simulation.plates[v : v + 1], poses=(poses_at(delay_s, n_frames),)
        )
        views.append([frame.images[0] for frame in seen.frames()])
    return simulation, tuple(Frame(t, t / FPS, images) for t, images in enumerate(zip(*views, strict=True)))


def poses_at(late_s, n_frames=30):
    """The true poses so much later than the frames."""
    recipe = Recipe("walking_on_the_spot", seconds=n_frames / FPS, fps=FPS)
    return poses_of(recipe.movement, recipe.subject.body(), recipe.times + late_s, recipe.heading_deg)


def tracked(simulation, off_s=0.0, lost=()):
    """The true poses, or those of a time so much later, as a run would have found them."""
    body, times = simulation.scene.persons[0].body, simulation.recipe.times
    estimates = [estimate_of(q, len(body.parts), t in lost) for t, q in enumerate(poses_at(off_s, len(times)))]
    return [Tracked(t, float(times[t]), (one,)) for t, one in enumerate(estimates)]


@functools.cache
def usually_aligned(*delays_s):
    """What the true poses of the moment in the middle tell of such views, once for all tests."""
    simulation, images = recorded(*delays_s)
    return aligned(simulation, images, tracked(simulation, float(np.mean(delays_s or 0.0))))


def aligned(simulation, images, frames, rig=None):
    scene = simulation.scene if rig is None else Scene(simulation.scene.persons, rig)
    return align(moments_of(scene, frames, chosen_moments(scene, frames), images), 1 / FPS)


def test_delays_by_parts_of_a_frame_are_found():
    found = usually_aligned(DELAYS_S)
    assert FEWEST <= found.n_moments <= 2 * MOST_MOMENTS
    assert found.delays_s == pytest.approx(DELAYS_S, abs=0.05 / FPS)
    assert (found.delay_sigmas_s[1:] > 0).all()
    assert found.delay_sigmas_s.max() < 0.05 / FPS
    assert found.out_of_step
    assert not found.turned
    assert len(found.findings()) == 1
    assert "out of step" in found.findings()[0]


@pytest.mark.parametrize("view", [0, 2])
def test_a_view_that_repeats_a_frame_is_told_and_brought_in_step(view):
    """Of the first view, by which delays are counted, as of any other one."""
    simulation, images = recorded(n_frames=LONGEST)
    repeats = tuple(
        replace(frame, images=tuple(images[t - (v == view and t >= 20)].images[v] for v in range(4)))
        for t, frame in enumerate(images)
    )
    found = aligned(simulation, repeats, tracked(simulation))
    last, first = found.change.between
    assert last < 20 <= first
    steps = np.delete(found.change.steps_s, view)
    # the first view's is found 0.21 of a frame short; of 30 frames 0.245, which rounding alone moves by 0.02
    assert found.change.steps_s[view] == pytest.approx(-1 / FPS, abs=0.25 / FPS)
    assert steps == pytest.approx(np.zeros(3), abs=0.05 / FPS)
    assert found.late
    assert len(found.findings()) == 1
    assert found.findings()[0].startswith(f"{found.rig.names[view]} runs ")
    assert " earlier from some frame between " in found.findings()[0]
    assert found.delays_at(0) is found.change.before_s
    assert found.delays_at(39) is found.change.after_s
    told = described(found)
    step_ms = [one["late_after_ms"] - one["late_before_ms"] for one in told.values()]
    assert step_ms == pytest.approx(1000 * found.change.steps_s, abs=1e-5)
    # of all that are not at an end or between, where delays are neither those before nor those after, every third one
    body, inner = simulation.scene.persons[0].body, [*range(2, last), *range(first + 1, 38)][::4]
    poses = dict(in_step(simulation.scene, tracked(simulation), found, [repeats[t] for t in inner]))
    marks = body.landmarks_in_world(np.array([poses[t][0].q for t in inner]))
    off_m = np.linalg.norm(marks - body.landmarks_in_world(simulation.poses[0][inner]), axis=2)
    assert off_m.mean() < 0.004, "of one moment on both sides, which is no other one where the first view repeats"


def test_turned_cameras_are_found_however_the_person_moves():
    simulation, images = recorded()
    rig = turned(simulation.scene.rig, -TURNS)
    found = aligned(simulation, images, tracked(simulation), rig)
    wanted = without_common_motion(rig, TURNS, found.middle)
    got = without_common_motion(rig, found.turns, found.middle)
    assert np.degrees(got) == pytest.approx(np.degrees(wanted), abs=0.06)
    assert found.late_frames == pytest.approx(np.zeros(4), abs=0.05)
    assert not found.out_of_step


def test_views_in_step_and_calibrated_are_not_suspected():
    found = usually_aligned()
    assert found.late_frames == pytest.approx(np.zeros(4), abs=0.03)
    assert found.change is None
    assert (found.delays_at(0) == found.delays_s).all()
    assert found.findings() == ()
    assert not any("late_before_ms" in told for told in described(found).values())


def test_poses_are_brought_to_the_first_views_moment():
    """As well as contours tell poses of views in step; what was tracked lies between the views' moments."""
    late, in_time = recorded(DELAYS_S), recorded()
    body, inner = late[0].scene.persons[0].body, range(2, 28, 3)
    truth = late[0].poses[0][inner]

    def off_mm(poses):
        marks = body.landmarks_in_world(np.array(poses)) - body.landmarks_in_world(truth)
        return 1000 * np.linalg.norm(marks, axis=2).mean()

    def brought(simulation, images, frames, found):
        poses = dict(in_step(simulation.scene, frames, found, [images[t] for t in inner]))
        assert sorted(poses) == list(inner)
        return off_mm([poses[t][0].q for t in inner])

    frames = tracked(late[0], float(np.mean(DELAYS_S)))
    before = off_mm([frames[t].estimates[0].q for t in inner])
    after = brought(*late, frames, usually_aligned(DELAYS_S))
    best = brought(*in_time, tracked(in_time[0]), usually_aligned())
    assert after - best < 0.3 * (before - best), (before, after, best)


def test_lost_frames_stay_as_they_are_and_missing_views_are_left_out():
    simulation, images = recorded()
    frames = tracked(simulation, lost=(0,))
    found = aligned(simulation, images, frames)
    blind = [replace(image, images=(None, *image.images[1:])) for image in images[:3]]
    poses = dict(in_step(simulation.scene, frames, found, blind))
    assert sorted(poses) == [0, 1, 2]
    assert poses[0][0] is frames[0].estimates[0]
    body = simulation.scene.persons[0].body
    off = body.landmarks_in_world(poses[2][0].q) - body.landmarks_in_world(simulation.poses[0][2])
    assert np.linalg.norm(off, axis=-1).mean() < 0.02


def test_rates_are_those_of_the_frames_around():
    simulation, _ = recorded()
    body, truth = simulation.scene.persons[0].body, simulation.poses[0]
    frames = tracked(simulation, lost=(9,))
    rates = rates_of(body, frames, 0)
    assert rates[4, 0] == pytest.approx((8 * (truth[5] - truth[3]) - truth[6] + truth[2]) * FPS / 12, abs=1e-9)
    assert rates[4, 1] == pytest.approx((truth[5] - 2 * truth[4] + truth[3]) * FPS**2, abs=1e-6)
    assert rates[1, 0] == pytest.approx((truth[2] - truth[0]) * FPS / 2, abs=1e-9)
    assert np.isnan(rates[9]).all()
    for blind in (0, 8, 10, 29):
        assert (rates[blind] == 0).all()


def test_angles_that_jump_have_no_rate():
    simulation, _ = recorded()
    body, frames = simulation.scene.persons[0].body, tracked(simulation)
    angle = int(np.flatnonzero(body.rotates)[0])
    for off, whole in ((np.pi, False), (2 * np.pi, True)):
        moved = np.array(frames[5].estimates[0].q)
        moved[angle] += off
        jumped = [*frames[:5], replace(frames[5], estimates=(replace(frames[5].estimates[0], q=moved),)), *frames[6:]]
        usual = rates_of(body, frames, 0)[4, 0, angle]
        assert rates_of(body, jumped, 0)[4, 0, angle] == pytest.approx(usual if whole else 0.0, abs=1e-9)


def test_frames_in_doubt_and_those_beside_them_tell_nothing():
    simulation, _ = recorded()
    frames = tracked(simulation)
    frames[10] = replace(frames[10], estimates=(in_doubt(frames[10].estimates[0], "left_arm"),))
    chosen = chosen_moments(simulation.scene, frames)
    assert not {0, 9, 10, 11, 29} & set(chosen)
    assert set(chosen) <= set(range(30))
    assert len(chosen) >= FEWEST


def test_a_small_body_moves_as_fast_as_a_person():
    """A tenth as large and as near it moves as many pixels: a hand's delays are told by its frames as well."""
    simulation, _ = recorded()
    frames, person, factor = tracked(simulation), simulation.scene.persons[0], 0.1
    moved = [np.where(person.body.rotates, one.estimates[0].q, factor * one.estimates[0].q) for one in frames]
    small = [replace(one, estimates=(replace(one.estimates[0], q=q),)) for one, q in zip(frames, moved, strict=True)]
    chosen = chosen_moments(enlarged(simulation.scene, factor), small)
    assert len(chosen) >= FEWEST
    assert set(chosen) <= set(chosen_moments(simulation.scene, frames))


def test_too_few_frames_or_one_view_tell_nothing():
    simulation, images = recorded()
    frames = tracked(simulation)
    moments = moments_of(simulation.scene, frames, chosen_moments(simulation.scene, frames), images)
    assert align(moments[: FEWEST - 1], 1 / FPS) is None
    alone = Scene(simulation.scene.persons, simulation.scene.rig.select(simulation.scene.rig.names[:1]))
    assert align([replace(moment, scene=alone) for moment in moments], 1 / FPS) is None


def test_turns_derive_as_finite_differences():
    rig = small_simulation("arm_swing", 1).scene.rig
    rng = np.random.default_rng(3)
    points, angles = rng.normal(size=(20, 3)) * 0.3 + [0, 0, 1.0], rng.uniform(0, 6, 20)
    normals, step = np.column_stack([np.cos(angles), np.sin(angles)]), 1e-6
    for v, camera in enumerate(rig.cameras):
        numeric = np.empty((20, 3))
        for axis in range(3):
            turns = np.zeros((len(rig), 3))
            turns[v, axis] = step
            ends = [turned(rig, sign * turns).cameras[v].project(points) for sign in (1, -1)]
            numeric[:, axis] = ((ends[0] - ends[1]) * normals).sum(axis=1) / (2 * step)
        assert by_turn(camera, points, normals) == pytest.approx(numeric, rel=1e-5, abs=1e-3)


def test_a_common_motion_of_what_is_seen_is_no_turn():
    rig = small_simulation("arm_swing", 1).scene.rig
    middle, moved = np.array([0.1, -0.2, 0.9]), np.array([0.004, -0.003, 0.002])
    seen = np.array([camera.in_camera(middle + moved) - camera.in_camera(middle) for camera in rig.cameras])
    depths = np.array([camera.in_camera(middle)[2] for camera in rig.cameras])
    turns = np.column_stack([-seen[:, 1] / depths, seen[:, 0] / depths, np.zeros(len(rig))])
    assert without_common_motion(rig, turns, middle) == pytest.approx(np.zeros((len(rig), 3)), abs=1e-12)
    left = without_common_motion(rig, TURNS, middle)
    assert without_common_motion(rig, left, middle) == pytest.approx(left, abs=1e-12)
    assert np.linalg.norm(left) > 0.3 * np.linalg.norm(TURNS)


def test_a_delay_is_told_from_five_sigmas_and_what_matters():
    rig = small_simulation("arm_swing", 1).scene.rig

    def made(delays_s, sigma_s, speed_m_per_s=1.0, n_moments=24):
        sigmas = np.array([0.0, *[sigma_s] * 3])
        return ViewAlignment(
            rig,
            0.04,
            np.array(delays_s),
            sigmas,
            np.zeros((4, 3)),
            np.full((4, 3), 1e-4),
            n_moments,
            np.ones(3),
            speed_m_per_s,
        )

    assert made([0, 0.02, 0, 0], 0.001).out_of_step
    assert not made([0, 0.02, 0, 0], 0.01).out_of_step, "not beyond doubt"
    assert not made([0, 0.004, 0, 0], 0.0001).out_of_step, "too little to matter"
    assert not made([0, 0.02, 0, 0], 0.001, 0.2).out_of_step, "hardly anything moves meanwhile"
    assert made([0, -0.014, -0.006, -0.014], 0.001).out_of_step
    assert not made([0, -0.014, -0.006, -0.014], 0.001, n_moments=10).out_of_step, "what does not fit is alike in few"
    assert made([0, 0.02, 0, 0], 0.001, n_moments=10).out_of_step


def told_of(simulation, images, lost=()):
    """The one line that a run says of views between which nothing is found."""
    frames, told = tracked(simulation, lost=lost), []
    steps = [SimpleNamespace(frame=frame, estimates=one.estimates) for frame, one in zip(images, frames, strict=True)]
    found = compared_views(steps, simulation.scene, 1 / FPS, lambda line, *_: told.append(line))
    assert found.findings() == ()
    (line,) = told
    return line


def test_views_in_step_are_said_to_be_so():
    told = told_of(*recorded())
    assert "views: in step to" in told
    assert re.search(r"in \d+ frames from \d+ to 2\d: of others", told), "a delay that grows shows later"


def test_views_are_not_called_in_step_where_a_part_of_the_run_tells_nothing():
    """A delay that grows is small where poses fit at all."""
    told = told_of(*recorded(), lost={*range(6), *range(18, 30)})
    assert "in step to" not in told
    assert "alone: too few to tell whether views are in step all along" in told
