"""Limbs that are elsewhere from one frame to the next are ambiguous on both sides; quick ones are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from doubted import in_doubt
from recordings import TrueStart, cycle_for, small_simulation

from tracker.bodies.body.description import load_body
from tracker.bodies.scene import Person, Scene
from tracker.foundation.resources import model_path
from tracker.tracking.doubt import Because
from tracker.tracking.estimate import Status
from tracker.tracking.jumps import with_jumps
from tracker.tracking.sequence import track
from tracker.tracking.trajectory import Step

N = 14


@pytest.fixture(scope="module")
def steps() -> list[Step]:
    """A person who stands still."""
    simulation = small_simulation("two_elbow_rotation", n_frames=2)
    first = next(iter(track(simulation.frames(), simulation.scene, cycle_for(simulation, TrueStart(simulation)))))
    still = replace(first.estimates[0], status=Status.TRACKED, doubts=())
    return [replace(first, estimates=(still,))] * N


def moved(steps: list[Step], shares: np.ndarray) -> list[Step]:
    """The left arm raised by shares of 60 degrees."""
    body = steps[0].scene.persons[0].body
    found = []
    for step, share in zip(steps, shares, strict=True):
        q = step.estimates[0].q.copy()
        q[body.index("left_arm_abduction")] += np.radians(60) * share
        found.append(replace(step, estimates=(replace(step.estimates[0], q=body.clamped(q)),)))
    return found


def told(steps: list[Step]) -> dict[int, tuple[str, ...]]:
    return {n: step.estimates[0].ambiguous for n, step in enumerate(steps) if step.estimates[0].ambiguous}


def test_who_stands_still_or_moves_quickly_is_not_doubted(steps):
    assert told(with_jumps(steps)) == {}
    # up in three frames, by 0.3, 0.4 and 0.3 of the way, and down again
    quick = np.array([0, 0, 0, 0, 0.3, 0.7, 1, 1, 0.7, 0.3, 0, 0, 0, 0])
    assert told(with_jumps(moved(steps, quick))) == {}


def test_a_jump_is_told_on_both_sides_while_the_limb_is_elsewhere(steps):
    # it drifts off while hidden and jumps back
    away = np.array([1.9, 1.75, 1.6, 1.45, 1.3, 1.2, 1.1, 1.05, 1, 0, 0, 0, 0, 0])
    found = told(with_jumps(moved(steps, away)))
    assert set(found) == set(range(1, 14))
    assert set(found.values()) == {("left_arm",)}
    for step in with_jumps(moved(steps, away))[1:]:
        (jump,) = step.estimates[0].doubts
        assert jump.because is Because.JUMP
        assert jump.value > jump.limit
    back = np.array([0, 0, 0, 0, 0, 0, 1, 0.8, 0.6, 0.4, 0.2, 0, 0, 0])
    found = told(with_jumps(moved(steps, back)))
    assert {4, 5, 6, 7, 8} <= set(found)
    assert not {11, 12, 13} & set(found)


@pytest.mark.parametrize(("carried_m", "sways", "first"), [(0.0, 0.0, 15), (0.02, 0.05, 15), (0.0, 1.9, 32)])
def test_a_limb_that_kept_its_place_on_the_body_is_doubted_for_a_second(steps, carried_m, sways, first):
    """Forty frames of 0.04 s, also of who walks on; one that has moved meanwhile for eight frames."""
    shares = np.concatenate([1 + np.linspace(sways, 0, 40), np.zeros(40)])
    found = []
    for n, step in enumerate(moved(steps[:1] * 80, shares)):
        q = step.estimates[0].q.copy()
        q[0] += carried_m * n
        estimates = (replace(step.estimates[0], q=q),)
        found.append(replace(step, estimates=estimates, frame=replace(step.frame, time_s=0.04 * n)))
    assert min(told(with_jumps(found))) == first
    assert max(told(with_jumps(found))) == 64


@pytest.mark.parametrize(
    ("shares", "expected"),
    [
        ([0] * 13 + [1], set(range(N))),
        ([1] + [0] * 13, set(range(N))),
        ([0] * 12 + [0.5, 1], set()),  # as quick as before
        ([0.04 * n for n in range(13)] + [1.2], set(range(4, N))),  # while it hardly moves on the body
    ],
)
def test_a_jump_into_the_last_frame_or_out_of_the_first_is_told(steps, shares, expected):
    """There one side alone shows that no movement is as quick."""
    assert set(told(with_jumps(moved(steps, np.array(shares))))) == expected


def test_of_frames_far_apart_the_ends_tell_nothing(steps):
    ends = moved(steps, np.array([0] * 13 + [1]))
    assert told(with_jumps([replace(s, frame=replace(s.frame, time_s=0.08 * n)) for n, s in enumerate(ends)])) == {}


def test_a_jump_from_the_window_before_is_told_behind_it(steps):
    up = moved(steps, np.ones(N))
    assert told(with_jumps(up)) == {}
    found = told(with_jumps(up, steps[0]))
    assert set(found) == set(range(N))
    assert told(with_jumps(up, up[0])) == {}


def test_a_jump_as_a_movement_begins_is_told(steps):
    """T-Punch-light's forearm came out from behind the back as the punch began: 37 cm, and 16 in the next frame."""
    begins = np.array([0, 0, 0, 0, 0, 0, 0, 1.1, 1.6, 2, 2, 2, 2, 2])
    assert {5, 6, 7, 8} <= set(told(with_jumps(moved(steps, begins))))
    # as far in the same frames, begun as a movement begins
    begins = np.array([0, 0, 0, 0, 0, 0.1, 0.4, 1.0, 1.6, 2, 2, 2, 2, 2])
    assert told(with_jumps(moved(steps, begins))) == {}


def test_a_frame_elsewhere_between_two_others_is_told(steps):
    """As R-UpperBody's left hand, 0.4 m off for one frame: the ways out and back are as long as each other."""
    lone = np.array([0, 0, 0, 0, 0, 0, 1, 0.1, 0, 0, 0, 0, 0, 0])
    assert told(with_jumps(moved(steps, lone))) == {6: ("left_arm",)}
    gone_on = np.array([0, 0, 0, 0, 0, 0, 1, 0.5, 0, 0, 0, 0, 0, 0])
    assert told(with_jumps(moved(steps, gone_on))) == {}


@pytest.mark.parametrize(("apart_s", "lone", "jumped"), [(0.04, True, True), (0.08, False, True), (0.2, False, False)])
def test_few_frames_a_second_tell_less(steps, apart_s, lone, jumped):
    """At 5 frames a second a kick goes out and back from one frame to the next."""

    def timed(shares: list[float]) -> list[Step]:
        found = moved(steps, np.array(shares))
        return [replace(one, frame=replace(one.frame, time_s=n * apart_s)) for n, one in enumerate(found)]

    assert bool(told(with_jumps(timed([0.0] * 6 + [1.0] + [0.0] * 7)))) == lone
    assert bool(told(with_jumps(timed([0.0] * 7 + [1.0] * 7)))) == jumped


@pytest.mark.parametrize(("before_deg", "after_deg", "elbow_deg"), [(0.0, 70.0, 0.0), (-60.0, 70.0, 7.0)])
def test_a_hand_that_turns_at_its_wrist_is_no_limb_elsewhere(steps, before_deg, after_deg, elbow_deg):
    """Not though the wrist goes some centimetres with it, as a man's who lay on his arm."""
    body = load_body(model_path("human"))
    scene = Scene((Person("one", body, body.rest()),), steps[0].scene.rig)
    ends = np.tile(body.rest(), (2, 1))
    ends[:, body.index("left_wrist_flexion")] = np.radians([before_deg, after_deg])
    ends[:, body.index("left_arm_extension")] += np.radians([0.0, elbow_deg])
    moved_m = np.linalg.norm(np.diff(body.landmarks_in_world(ends), axis=0)[0], axis=1)
    assert moved_m[body.landmark_names.index("left_hand")] > 0.15
    assert moved_m[body.landmark_names.index("left_wrist")] == pytest.approx(0.03 * (elbow_deg > 0), abs=0.01)
    still = steps[0].estimates[0]
    poses = [ends[int(n >= 7)] for n in range(N)]
    found = [replace(steps[0], scene=scene, estimates=(replace(still, q=q),)) for q in poses]
    assert told(with_jumps(found)) == {}


def test_who_was_found_anew_has_not_jumped(steps):
    away = moved(steps, np.array([0.0] * 7 + [1.0] * 7))
    assert told(with_jumps(away))
    away[7] = replace(away[7], estimates=(replace(away[7].estimates[0], status=Status.RECOVERED),))
    assert told(with_jumps(away)) == {}


def test_what_was_ambiguous_stays_so_once(steps):
    away = moved(steps, np.array([0.0] * 7 + [1.0] * 7))
    away = [replace(one, estimates=(in_doubt(one.estimates[0], "left_arm", "left_leg"),)) for one in away]
    assert set(told(with_jumps(away)).values()) == {("left_arm", "left_leg")}


@pytest.mark.parametrize("shares", [[0.0], [0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 1.0, 1.0]])
def test_a_few_frames_tell_nothing(steps, shares):
    assert told(with_jumps(moved(steps[: len(shares)], np.array(shares)))) == {}
