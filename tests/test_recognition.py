"""Recognition: features that know no place, heading or body; matching like its slow twin; ends found; unknown said."""

from __future__ import annotations

import functools
import itertools
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from known_movements import BODY, LIBRARY, known
from scipy.spatial.transform import Rotation

from tracker.bodies.body.description import load_body
from tracker.bodies.keypoints import meant
from tracker.foundation.errors import ConfigError, ModelError
from tracker.foundation.resources import model_path
from tracker.kernels.movements import direction_gaps, warp_sequence
from tracker.results.recognition import (
    FEATURES,
    JOINTS,
    RATE_HZ,
    Course,
    course,
    course_of,
    features_of,
    limb_directions,
)
from tracker.results.recognition.library import Description, Library, Movement, one_round
from tracker.results.recognition.matching import (
    Recognized,
    _together,
    angles_deg,
    recognize,
    strip,
    table_rows,
    timeline,
)
from tracker.synthesis.simulation.movements import poses_of


def joints_of(body, poses):
    return body.landmarks_in_world(poses)[:, [body.landmark_names.index(name) for name in JOINTS]]


def some_poses(n=6, seed=0):
    rng = np.random.default_rng(seed)
    q = rng.normal(0, 0.5, (n, BODY.dof))
    return BODY.clamped(q)


def chained(*courses, seam=8):
    """Courses one after the other, each turned into the next one; and the frames where they begin and end."""
    pieces, ends, length = [], [], 0
    for k, one in enumerate(courses):
        if k:
            share = np.linspace(0, 1, seam + 2)[1:-1, None, None]
            between = (1 - share) * pieces[-1][-1] + share * one[0]
            pieces.append(between / np.linalg.norm(between, axis=-1, keepdims=True))
            length += seam
        pieces.append(one)
        ends.append((length / RATE_HZ, (length + len(one) - 1) / RATE_HZ))
        length += len(one)
    directions = np.concatenate(pieces).astype(np.float32)
    return Course(0.0, directions, np.ones(length, dtype=bool)), ends


def test_features_do_not_depend_on_place_heading_or_size():
    joints = joints_of(BODY, some_poses())
    turned = 0.63 * Rotation.from_rotvec([0, 0, 2.1]).apply(joints.reshape(-1, 3)).reshape(joints.shape) + (3, -2, 0.4)
    found = limb_directions(turned)
    np.testing.assert_allclose(found, limb_directions(joints), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found, axis=-1), 1, atol=1e-12)


def test_only_the_vertical_tells_lying_from_standing():
    joints = joints_of(BODY, some_poses())
    lying = Rotation.from_rotvec([0, 1.4, 0]).apply(joints.reshape(-1, 3)).reshape(joints.shape)
    standing_limbs, lying_limbs = limb_directions(joints), limb_directions(lying)
    np.testing.assert_allclose(lying_limbs[:, :-1], standing_limbs[:, :-1], atol=1e-12)
    angle = np.arccos(np.sum(standing_limbs[:, -1] * lying_limbs[:, -1], axis=-1))
    assert angle.min() > 0.5


def test_features_of_the_reference_pose_point_down_and_the_vertical_up():
    found = dict(zip(FEATURES, limb_directions(joints_of(BODY, BODY.rest()[None]))[0], strict=True))
    for name, direction in found.items():
        np.testing.assert_allclose(direction, (0, 0, 1 if name == "vertical" else -1), atol=1e-9)
    q = BODY.rest()
    q[BODY.index("left_arm_elevation")] = np.pi / 3
    raised = limb_directions(joints_of(BODY, q[None]))[0][FEATURES.index("left_upper_arm")]
    np.testing.assert_allclose(raised, (np.sin(np.pi / 3), 0, -0.5), atol=1e-9)


def test_a_mirrored_course_is_that_of_mirrored_joints():
    joints = joints_of(BODY, some_poses(40))
    times = np.arange(len(joints)) / RATE_HZ
    mirrored = (joints * (1, -1, 1))[:, [*range(6, 12), *range(6)]]
    np.testing.assert_allclose(
        course(times, joints).mirrored().directions, course(times, mirrored).directions, atol=1e-5
    )


def test_body_models_compare():
    human = load_body(model_path("human"))
    times = np.arange(0, 2, 0.04)
    ours, theirs = (course_of(body, times, poses_of("arm_swing", body, times)).directions for body in (BODY, human))
    gaps = 2 * np.degrees(np.arcsin(np.linalg.norm(ours - theirs, axis=-1) / 2))
    assert np.sqrt(np.mean(gaps**2)) < 6


def test_who_goes_over_the_floor_does_not_walk_on_the_spot():
    times = np.arange(0, 3, 0.04)
    poses = poses_of("walking_on_the_spot", BODY, times)
    staying = recognize(course_of(BODY, times, poses), LIBRARY)
    assert [one.movement for one in staying] == ["walking_on_the_spot"]
    assert staying[0].speed < 0.05
    poses[:, BODY.index("torso_x")] += 0.8 * times
    going = course_of(BODY, times, poses)
    assert going.speed == pytest.approx(0.8 / 0.85, rel=0.1)
    assert "walking_on_the_spot" not in [one.movement for one in recognize(going, LIBRARY)]


def test_frames_are_interpolated_over_short_gaps_only():
    poses = poses_of("walking_on_the_spot", BODY, np.arange(0, 3, 0.02))
    lost = poses.copy()
    lost[20:28] = np.nan  # 0.16 s
    lost[70:100] = np.nan  # 0.6 s
    times = 7.0 + np.arange(len(poses)) * 0.02
    whole, found = course_of(BODY, times, poses), course_of(BODY, times, lost)
    assert whole.known.all()
    assert found.start_s == 7.0
    unknown = found.times_s[~found.known]
    assert unknown[0] >= times[69]
    assert unknown[-1] <= times[100]
    assert len(unknown) >= 14
    chords = np.linalg.norm(found.directions - whole.directions, axis=-1)[found.known]
    assert np.degrees(chords.max()) < 8
    assert not course_of(BODY, times, np.full_like(poses, np.nan)).known.any()


def test_a_segment_with_the_name_of_the_vertical_is_refused():
    body = load_body(model_path("quadruped"))
    parts = (replace(body.parts[0], segment="vertical"), *body.parts[1:])
    with pytest.raises(ModelError, match='a direction "vertical": give the segment another name'):
        features_of(replace(body, parts=parts))


def test_segments_of_an_animal_do_not_depend_on_place_and_heading():
    body, times = load_body(model_path("quadruped")), np.arange(0, 1, 0.04)
    found = course_of(body, times, poses_of("trot", body, times))
    elsewhere = course_of(body, times, poses_of("trot", body, times, heading_deg=130.0, place=(3.0, -2.0)))
    np.testing.assert_allclose(found.directions, elsewhere.directions, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(found.directions, axis=-1), 1, atol=1e-6)
    assert found.features.names[-1] == "vertical"
    assert "front_left_lower" in found.features.names
    assert "trunk" not in found.features.names, "always points the same way, seen from itself"


def test_segments_of_the_other_side_are_mirrored():
    body = load_body(model_path("quadruped"))
    left, right = (np.tile(body.rest(), (2, 1)) for _ in range(2))
    for q, side, sign in ((left, "left", 1), (right, "right", -1)):
        q[:, body.index(f"front_{side}_swing")] = 0.4
        q[:, body.index("trunk_roll")] = 0.2 * sign
    one, other = (course_of(body, np.arange(2) / RATE_HZ, q) for q in (left, right))
    np.testing.assert_allclose(one.mirrored().directions, other.directions, atol=1e-6)
    assert np.abs(one.directions - other.directions).max() > 0.1


def test_a_person_whose_joints_are_called_otherwise_is_a_person():
    times = np.arange(0, 1, 0.04)
    short = [re.sub(r"(left|right)_(.*)", r"\2_\1", mark.name) for mark in BODY.landmarks]
    named = replace(BODY, landmarks=tuple(replace(m, name=n) for m, n in zip(BODY.landmarks, short, strict=True)))
    found, usual = (course_of(body, times, poses_of("squat", BODY, times)) for body in (named, BODY))
    assert found.features == usual.features
    np.testing.assert_array_equal(found.directions, usual.directions)


def test_gaps_are_root_mean_square_angles_by_weight():
    rng = np.random.default_rng(0)
    one, other = (rng.normal(size=(n, 9, 3)) for n in (4, 5))
    one, other = (a / np.linalg.norm(a, axis=-1, keepdims=True) for a in (one, other))
    other[0] = -one[0]
    gaps = np.zeros((4, 5), np.float32)
    weights = rng.dirichlet(np.ones(9))
    direction_gaps(one.astype(np.float32), other.astype(np.float32), weights.astype(np.float32), gaps)
    angles = np.degrees(np.arccos(np.clip(np.einsum("tlc,nlc->tnl", one, other), -1, 1)))
    np.testing.assert_allclose(gaps, np.sqrt((angles**2) @ weights), rtol=1e-4)
    assert gaps[0, 0] == pytest.approx(180, rel=1e-4)


def slowest(gaps, first, repeats, slack, unknown, entry):
    """The same by trying every path: the least cost of explaining frames t, ... behind a state."""
    n_frames = len(gaps)

    @functools.cache
    def after(t, k, j, held):
        """Frames t, ... explained, performance k being at frame j, met twice already or not."""
        length = first[k + 1] - first[k]
        leaves = repeats[k] or j >= length - 1 - slack[k]
        costs = [free(t)] if leaves else []
        if t < n_frames:
            steps = [(1, False), (2, False)] + ([] if held else [(0, True)])
            for step, again in steps:
                i = (j + step) % length if repeats[k] else j + step
                if i < length:
                    costs.append(gaps[t, first[k] + i] + after(t + 1, k, i, again))
        return min(costs, default=math.inf)

    @functools.cache
    def free(t):
        if t == n_frames:
            return 0.0
        costs = [unknown + free(t + 1)]
        for n in range(len(gaps[0])):
            k = int(np.searchsorted(first, n, side="right")) - 1
            if repeats[k] or n - first[k] <= slack[k]:
                costs.append(entry + gaps[t, n] + after(t + 1, k, n - first[k], False))
        return min(costs)

    return free(0)


@pytest.mark.parametrize("seed", range(30))
def test_one_pass_finds_the_cheapest_of_all_ways(seed):
    rng = np.random.default_rng(seed)
    lengths = rng.integers(2, 6, 3)
    first = np.concatenate([[0], np.cumsum(lengths)])
    repeats = np.array([True, False, False])
    slack = np.array([0, 0, 1])
    gaps = rng.uniform(0, 2, (rng.integers(1, 9), first[-1])).astype(np.float32)
    unknown, entry = ((1.0, 0.4), (math.inf, 0.0), (0.3, 1.0))[seed % 3]
    found = np.zeros((len(gaps) + 1, 3), np.int64)
    cost = warp_sequence(gaps, first, repeats, slack, unknown, entry, found)
    assert cost == pytest.approx(slowest(gaps, first, repeats, slack, unknown, entry), rel=1e-5)


def test_every_known_movement_is_recognized_as_itself():
    for name, movement in LIBRARY.movements.items():
        for directions in movement.performances.values():
            times = 2 if movement.description.repeats else 1
            asked, _ = chained(*[directions] * times, seam=0)
            found = recognize(asked, LIBRARY)
            assert [one.movement for one in found] == [name]
            assert found[0].angle_deg < 0.5
            assert found[0].second_deg > found[0].angle_deg
            assert found[0].end_s - found[0].start_s >= asked.seconds - 0.3


def test_movements_are_found_with_their_beginnings_and_ends():
    names = ["kick", "walk", "squat", "jump"]
    asked, ends = chained(*(known(name) for name in names))
    found = recognize(asked, LIBRARY)
    assert [one.movement for one in found] == names
    for one, (start, end) in zip(found, ends, strict=True):
        assert one.start_s == pytest.approx(start, abs=0.25)
        assert one.end_s == pytest.approx(end, abs=0.25)


def test_repetitions_are_one_only_where_the_movement_repeats():
    asked, _ = chained(*[known("walk")] * 3, seam=0)
    assert [(one.movement, one.end_s) for one in recognize(asked, LIBRARY)] == [("walk", asked.seconds - 1 / RATE_HZ)]
    asked, _ = chained(known("kick"), known("kick"))
    assert [one.movement for one in recognize(asked, LIBRARY)] == ["kick", "kick"]


def test_the_next_best_movement_and_its_angle_belong_together():
    short = Recognized("walk", 0.0, 0.96, 5.0, 0.5, "crawl", 60.0, False, "a", 1.0, 1.0)
    longer = Recognized("walk", 1.0, 3.96, 7.0, 0.7, "run", 20.0, False, "b", 1.0, 2.0)
    told = _together(short, longer)
    assert (told.angle_deg, told.second, told.second_deg) == (pytest.approx(6.5), "run", 20.0)
    told = _together(replace(short, second="", second_deg=np.inf), longer)  # no other one fits the shorter one's length
    assert (told.second, told.second_deg) == ("run", 20.0)
    assert _together(replace(short, second="run"), longer).second_deg == pytest.approx(30.0)


@pytest.mark.parametrize("tempo", [0.6, 1.7])
def test_movements_are_recognized_at_another_tempo(tempo):
    directions = known("punch").astype(np.float64)
    at = np.arange(0, len(directions) - 1, tempo)
    warped = np.stack([np.interp(at, range(len(directions)), c) for c in directions.reshape(len(directions), -1).T], 1)
    warped = warped.reshape(len(at), -1, 3)
    warped /= np.linalg.norm(warped, axis=-1, keepdims=True)
    found = recognize(Course(0.0, warped.astype(np.float32), np.ones(len(at), bool)), LIBRARY)
    assert [one.movement for one in found] == ["punch"]


def test_a_movement_is_told_by_directions_that_there_are():
    told = Description(told_by=("left_tigh",))
    with pytest.raises(ConfigError, match=r'"kick": told_by: "left_tigh"; .*left_thigh'):
        recognize(
            Course(0.0, known("kick"), np.ones(39, bool)),
            Library({"kick": Movement("kick", told, {"a": known("kick")})}),
        )


def test_left_and_right_may_be_exchanged():
    asked = Course(0.0, known("kick"), np.ones(len(known("kick")), bool))
    (plain,), (turned,) = recognize(asked, LIBRARY), recognize(asked.mirrored(), LIBRARY)
    assert (plain.movement, plain.mirrored) == ("kick", False)
    assert (turned.movement, turned.mirrored) == ("kick", True)
    assert turned.angle_deg == pytest.approx(plain.angle_deg, abs=0.1)


def test_what_is_like_nothing_known_is_unknown():
    rest = Library({name: one for name, one in LIBRARY.movements.items() if name != "cartwheel"})
    asked = Course(0.0, known("cartwheel"), np.ones(len(known("cartwheel")), bool))
    assert recognize(asked, rest) == ()
    assert min(angles_deg(asked, rest).values()) > 25


def test_what_is_lost_breaks_a_movement():
    directions = np.tile(known("walk"), (4, 1, 1))
    seen = np.ones(len(directions), bool)
    seen[50:70] = False
    found = recognize(Course(0.0, directions, seen), LIBRARY)
    assert [one.movement for one in found] == ["walk", "walk"]
    assert found[0].end_s == pytest.approx(49 / RATE_HZ)
    assert found[1].start_s == pytest.approx(70 / RATE_HZ)
    stretches = timeline(Course(0.0, directions, seen), found)
    assert [one.what for one in stretches] == ["walk", "lost", "walk"]


def test_a_round_is_cut_out_of_what_repeats():
    times = np.arange(0, 5, 0.04)
    whole = course_of(BODY, times, poses_of("walking_on_the_spot", BODY, times))
    kept = one_round(whole)
    assert kept.seconds == pytest.approx(1.1, abs=0.05)
    assert abs(len(one_round(kept).known) - len(kept.known)) <= 1
    clip = Course(0.0, known("run"), np.ones(len(known("run")), bool))  # exactly a round
    assert one_round(clip) is clip
    bend = np.linspace(0, 1.6, 40)
    poses = np.tile(BODY.rest(), (40, 1))
    for name in ("left_arm_elevation", "right_leg_elevation", "left_leg_extension"):
        poses[:, BODY.index(name)] = bend
    with pytest.raises(ConfigError, match="does not return"):
        one_round(course_of(BODY, np.arange(40) / 25, poses))


def test_a_library_may_be_of_one_movement():
    one = Library({"kick": Movement("kick", Description(), {"a": known("kick")})})
    asked, _ = chained(known("walk"), known("kick"))
    (found,) = recognize(asked, one)
    assert (found.movement, found.second, found.second_deg) == ("kick", "", math.inf)
    rows = list(table_rows({"anna": timeline(asked, (found,))}))
    assert [row[1] for row in rows] == ["movement", "unknown", "kick"]
    assert {len(row) for row in rows} == {13}


def test_the_strip_shows_every_movement():
    asked, _ = chained(known("walk"), known("kick"))
    stretches = timeline(asked, recognize(asked, LIBRARY))
    figure = strip("run", {"anna": stretches, "ben": ()})
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert [text.partition("\n")[0] for text in texts] == ["walk", "kick"]
    assert len(figure.axes[0].patches) == len(stretches)
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == ["anna", "ben"]


def test_persons_of_other_laboratories_walk(data):
    """Eleven walks and a run of CMU's database, nobody of whom is in the library."""
    import sys
    from pathlib import Path

    sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))
    from benchmarks.motion_files import read_cmu

    folder = data("motions/cmu")
    for path in itertools.chain(sorted(folder.glob("07_*-walk.amc")), [folder / "09_06-run.amc"]):
        motion = read_cmu(path)
        asked = course(motion.times_s, motion.joints)
        found = recognize(asked, LIBRARY)
        assert {one.movement for one in found} == {"run" if "run" in path.name else "walk"}
        assert sum(one.end_s - one.start_s for one in found) > 0.7 * asked.seconds


def test_the_library_has_the_joints_that_it_is_made_of():
    assert len(JOINTS) == 12
    assert all(len(meant(JOINTS, load_body(model_path(name))).rows) == 12 for name in ("gavrila22", "human"))
    assert len(meant(JOINTS, load_body(model_path("quadruped"))).rows) < 12
