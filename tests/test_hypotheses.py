"""Start poses that are tried, turned round, ranked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from doubted import in_doubt

from tests.motions import estimate_of
from tests.observations import bent, four_views
from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.bodies.limbs import turned_round
from tracker.bodies.scene import Person, Scene
from tracker.cameras.frame import Frame
from tracker.foundation.resources import model_path
from tracker.tracking.hypotheses import apart, coarse_poses, finalists, hypothesis, ranked
from tracker.tracking.initialization._drafts import Draft, likeliest_of
from tracker.tracking.start import Hypothesis, confidence

# Of the same four poses in two foregrounds.
LEFT_OVER = (0.3, 0.4, 0.5, 0.6), (0.45, 0.7, 0.8, 0.35)


def tried(q: np.ndarray, left_over: float) -> Hypothesis:
    return Hypothesis(q, 3.0, 0.9, left_over, 0.0)


def test_coarse_poses_are_all_combinations(body: BodyModel) -> None:
    starts = [body.rest(), bent(body)]
    poses = coarse_poses(body, starts, np.arange(-180.0, 180.0, 90.0), {"left_arm_abduction": (10.0, 90.0)})
    assert len(poses) == 2 * 4 * 2
    kept = [k for k, name in enumerate(body.names) if name not in ("torso_twist", "left_arm_abduction")]
    np.testing.assert_allclose(poses[8:, kept], np.tile(body.clamped(bent(body))[kept], (8, 1)))
    assert len(np.unique(np.round(poses[:8, [5, body.index("left_arm_abduction")]], 6), axis=0)) == 8


def test_the_best_poses_with_different_turns_are_chosen(body: BodyModel) -> None:
    poses = coarse_poses(body, [body.rest()], np.arange(-180.0, 180.0, 15.0), {})
    distances = np.abs(np.degrees(poses[:, 5]) - 10)
    turns = [np.degrees(q[5]) for q in apart(body, poses, distances, (3, 60.0))]
    assert turns[0] == pytest.approx(15) or turns[0] == pytest.approx(0)
    gaps = np.abs((np.subtract.outer(turns, turns) + 180) % 360 - 180) + 1e3 * np.eye(3)
    assert gaps.min() >= 60 - 1e-9


@pytest.mark.parametrize("name", ["gavrila22", "human"])
def test_someone_turned_round_holds_the_other_arm_in_the_same_place(name: str) -> None:
    body = load_body(model_path(name))
    q = body.rest()
    q[body.index("left_arm_abduction")] = 1.2
    back = turned_round(body, q)
    marks, others = body.landmarks_in_world(np.array([q, back]))
    left, right = (body.landmark_names.index(f"{side}_wrist") for side in ("left", "right"))
    assert np.linalg.norm(marks[left] - others[right]) < 0.01
    again = turned_round(body, back)
    # shoulders and hands of `human` lie before the length of the trunk, and are reached for: hands end 14 mm beside
    most_m = {"gavrila22": 0.0005, "human": 0.015}[name]
    assert np.linalg.norm(body.landmarks_in_world(again) - body.landmarks_in_world(q), axis=1).max() < most_m


@pytest.mark.parametrize("name", ["gavrila22", "human"])
def test_someone_turned_round_has_joints_where_those_of_the_other_side_were(name: str) -> None:
    """As far as they bend that way: who leans forwards by the spine does not lean backwards turned round."""
    body, rng, off_m = load_body(model_path(name)), np.random.default_rng(0), []
    names = body.landmark_names
    places = [names.index(body.mirror.of(one)) for one in names]
    moved = body.rotates.copy()
    moved[body.carrying] = False
    for _ in range(20):
        q = body.rest()
        q[moved] += 0.3 * rng.normal(size=int(moved.sum()))
        q[body.index(body.start.turn)] = rng.uniform(-np.pi, np.pi)
        q = body.clamped(q)
        off_m.append(body.landmarks_in_world(turned_round(body, q)) - body.landmarks_in_world(q)[places])
    by_joint = dict(zip(names, np.linalg.norm(off_m, axis=2).mean(axis=0), strict=True))
    # knees bend one way, and feet point there
    arms = [by_joint[one] for one in names if one.endswith(("shoulder", "elbow", "wrist"))]
    assert max(arms) < 0.08
    assert max(by_joint[one] for one in ("neck", "pelvis", "head_top") if one in by_joint) < 0.035


def test_an_animal_turned_round_is_not_bent_to_where_its_head_was() -> None:
    """Its head is at the other end then."""
    body = load_body(model_path("quadruped"))
    q = body.rest()
    back, turn = turned_round(body, q), body.index(body.start.turn)
    np.testing.assert_array_equal(np.delete(back, turn), np.delete(q, turn))


def test_the_same_pose_counts_once_and_the_best_comes_first(body: BodyModel) -> None:
    q = bent(body)
    other = turned_round(body, q)
    order = ranked(body, [tried(other, 0.5), tried(q, 0.4), tried(q + 1e-3, 0.45)])
    assert [one.left_over for one in order] == [0.4, 0.5]


def test_a_pose_that_no_image_shows_leaves_all_over(body: BodyModel) -> None:
    estimate = estimate_of(bent(body), len(body.parts), lost=False)
    assert hypothesis(body, estimate).left_over == estimate.account.left_over < 1
    nothing = np.zeros(len(body.parts))
    account = replace(estimate.account, visible_px=nothing, explained_px=nothing, missed_px=nothing)
    assert account.left_over == 0
    assert hypothesis(body, replace(estimate, account=account)).left_over == 1


def test_somebody_who_faces_the_other_way_stays_among_those_followed(body: BodyModel) -> None:
    """Of somebody whose legs no view shows the first ones may differ in these alone."""

    def facing(turn_deg: float) -> Hypothesis:
        return replace(tried(bent(body), 0.4), turn_deg=turn_deg)

    front = [facing(turn_deg) for turn_deg in (144.0, 143.0, -170.0)]
    aside, back, again = facing(60.0), facing(-55.0), facing(-40.0)
    assert finalists([*front, aside, back, again], 3) == (*front, back)
    assert finalists([*front, aside], 3) == tuple(front), "nobody faces the other way"
    assert finalists([*front[:2], back, again], 3) == (*front[:2], back), "somebody does already"
    assert finalists(front[:1], 3) == (front[0],)


def drafted(body: BodyModel, *rankings: tuple[Hypothesis, ...]) -> list[list[Draft]]:
    """One person in as many foregrounds."""
    scene = Scene((Person("one", body, body.rest()),), four_views())
    frame = Frame(0, 0.0, (None,) * 4)
    return [[Draft(frame, scene.with_pose(0, own[0].q), (), ((),), (own,))] for own in rankings]


def test_of_several_foregrounds_the_best_hypotheses_of_all_are_estimated(body: BodyModel) -> None:
    """In each of three the best seven took half of a start, though one foreground had all that could be right."""
    q = bent(body)
    poses = [q + shift * np.eye(body.dof)[0] for shift in (0.0, 0.5, 1.0, 1.5)]
    near, far = [tuple(tried(pose, left) for pose, left in zip(poses, lefts, strict=True)) for lefts in LEFT_OVER]
    kept = likeliest_of(drafted(body, near, far, (tried(poses[1], 0.9),)), 3)
    assert [[one.left_over for one in ways[0].hypotheses[0]] for ways in kept] == [[0.3, 0.4], [0.35]]
    np.testing.assert_array_equal(kept[1][0].scene.persons[0].q, poses[3], "in the best that is left")
    assert kept[0][0].sought == [0]


def test_among_those_estimated_one_faces_the_other_way(body: BodyModel) -> None:
    q = bent(body)
    front = tuple(replace(tried(q + shift * np.eye(body.dof)[0], 0.3), turn_deg=5.0) for shift in (0.0, 0.5))
    back = replace(tried(turned_round(body, q), 0.9), turn_deg=-170.0)
    kept = likeliest_of(drafted(body, front, (back,)), 2)
    assert [ways[0].hypotheses[0] for ways in kept] == [front, (back,)]


def test_several_bodies_or_a_single_foreground_keep_all_hypotheses(body: BodyModel) -> None:
    rankings = tuple((tried(bent(body) + shift * np.eye(body.dof)[0], 0.3),) for shift in (0.0, 0.5, 1.0))
    one, two, three = drafted(body, *rankings)
    several = [[*one, *two], three]
    assert likeliest_of(several, 1) is several
    assert likeliest_of([one], 1) == [one]
    assert likeliest_of([], 1) == []


def test_what_tracking_doubts_counts_for_more_than_how_sure_a_start_was(body: BodyModel) -> None:
    right = estimate_of(body.rest(), len(body.parts), lost=False)
    one, two = in_doubt(right, "left_arm"), in_doubt(right, "left_arm", "right_leg")
    wrong = (two, in_doubt(right, whole=True), estimate_of(body.rest(), len(body.parts), lost=True))
    for sure in (0.0, 0.4, 1.0):
        assert all(confidence(sure, estimate) <= 0.5 <= confidence(sure, one) for estimate in wrong)
        assert confidence(sure, one) <= confidence(sure, right) <= 1.0
    assert confidence(1.0, one) < 0.9 < confidence(1.0, right)
    assert confidence(0.3, right) < confidence(0.7, right)
