"""What a run knows of its own doubt, it says: frames that the images do not support, limbs that may be elsewhere."""

from __future__ import annotations

import csv
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from doubted import IMAGES, after_all, estimate_of, in_doubt, steps_of
from hypothesis import given
from hypothesis import strategies as st
from observations import ideal, objective_of
from recordings import TrueStart, cycle_for, small_simulation, with_images

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.images.sight import Observation
from tracker.results.recording import RunContext
from tracker.results.recording._drawing import states_of
from tracker.results.recording._journal_line import line_of, replay_of
from tracker.results.recording._series import Series
from tracker.results.recording.csv_table import CsvTable
from tracker.tracking.doubt import Because, Doubt
from tracker.tracking.doubts import Doubts, ranges
from tracker.tracking.estimate import Estimate, Status
from tracker.tracking.initialization._person_sized import enlarged
from tracker.tracking.limb_probabilities import left_over_of, limb_probabilities, limb_spreads_m, limbs_left_over
from tracker.tracking.loss import (
    LossRule,
    Troubles,
    doubted,
    judged,
    sought_anew,
    trusted_parts,
)
from tracker.tracking.sequence import track
from tracker.tracking.start import FACES_RIGHTLY, Hypothesis, Start
from tracker.tracking.trajectory import Step


def test_the_truth_is_not_doubted(truth: Scene, observation: Observation) -> None:
    found = estimate_of(truth, observation)
    assert found.verdict is Status.TRACKED
    assert found.ambiguous == ()


@pytest.mark.parametrize("limb", ["left_arm", "right_arm", "left_leg", "right_leg"])
def test_a_limb_elsewhere_is_named(truth: Scene, observation: Observation, limb: str) -> None:
    found = estimate_of(truth, observation, **{f"{limb}_abduction": 60.0})
    assert limb in found.ambiguous
    # what a leg has left behind lies nearest to the other leg, which is then in doubt, too
    kind = limb.partition("_")[2]
    assert all(group.endswith(kind) for group in found.ambiguous)


def test_a_head_elsewhere_is_named() -> None:
    """Bent forward from the start on, before a background that was learnt as its own, it was silent in all frames."""
    scene = small_simulation("two_elbow_rotation", n_frames=1, model="human").scene
    seen = ideal(scene)
    assert estimate_of(scene, seen).ambiguous == ()
    found = estimate_of(scene, seen, neck_elevation=60.0)
    assert found.ambiguous == ("head",)
    head = scene.persons[0].body.parts_of("head")
    assert not trusted_parts(scene.persons[0].body, found)[:, head].any()
    # hair and a hat may be left over: of a head less counts than of an arm
    left_over = limbs_left_over(scene.persons[0].body, found.account)
    assert left_over["head"] == pytest.approx(left_over_of(found.account.of(head)) - 0.2)


def test_a_body_elsewhere_is_doubtful(truth: Scene, observation: Observation) -> None:
    limbs = {f"{side}_{limb}_abduction": 50.0 for side in ("left", "right") for limb in ("arm", "leg")}
    found = estimate_of(truth, observation, **limbs)
    assert found.doubtful
    assert found.verdict in (Status.DOUBTFUL, Status.LOST)
    assert replace(found, status=Status.LOST).verdict is Status.LOST


def test_nothing_is_learned_from_a_doubtful_frame() -> None:
    """Evidence is told what it may trust; histories go on, for the next frame's prediction needs them."""
    simulation = small_simulation(n_frames=3)
    told: list[list[list[bool]]] = []

    class Listening(type(cycle_for(simulation).evidence)):  # type: ignore[misc]
        def learned(self, memory, sight, scene, fitted, trusted):  # type: ignore[no-untyped-def]
            told.append(trusted.tolist())
            return memory

    for above, trusted in ((5.0, True), (0.0, False)):
        told.clear()
        cycle = cycle_for(simulation, TrueStart(simulation), evidence=Listening(), loss=LossRule(doubtful_above=above))
        steps = list(track(simulation.frames(), simulation.scene, cycle))
        assert told == [[[trusted] * len(simulation.scene.shapes)] * len(simulation.scene.rig)] * 3
        verdicts = {Status.TRACKED, Status.BOOTSTRAPPED} if trusted else {Status.DOUBTFUL}
        assert {step.estimates[0].verdict for step in steps} == verdicts
        assert steps[-1].estimates[0].status is Status.TRACKED


def test_one_line_says_where_to_look(truth: Scene, observation: Observation) -> None:
    sure = in_doubt(estimate_of(truth, observation))
    unsure, arm = in_doubt(sure, whole=True), in_doubt(sure, "left_arm")
    lost = replace(in_doubt(sure, "right_leg", whole=True), status=Status.LOST)
    fitted = objective_of(truth, observation).asked.fine(truth.persons[0].q)
    doubts = Doubts()
    assert doubts.none
    for k, estimate in enumerate((sure, unsure, unsure, arm, lost, arm)):
        doubts = doubts.after(Step(Frame(10 + k, 0.04 * k, IMAGES), truth, (estimate,), fitted))
    assert doubts.sentence() == (
        "of 6 frames 1 lost (frame 14), 2 doubtful (frames 11-12), left arm ambiguous in 2 (frames 13, 15)"
    )
    assert Doubts(3).sentence() == "no frame of 3 lost, doubtful or with an ambiguous limb"


@pytest.mark.parametrize(("sure", "doubtful", "told"), [(0.06, True, True), (0.06, False, False), (1.0, True, False)])
def test_a_start_that_is_rather_wrong_than_right_is_told(
    truth: Scene, observation: Observation, sure: float, doubtful: bool, told: bool
) -> None:
    """By the first start alone, also when the journal tells of it; of later ones the frames tell."""
    estimate = in_doubt(estimate_of(truth, observation), whole=doubtful)
    begun, *others = steps_of(truth, observation, [[estimate]] * 3)
    start = Start((truth.persons[0].q,), sureness=(sure,))
    later = replace(others[0], start=replace(start, sureness=(0.0,)))
    begun = replace(begun, start=start)
    kept = replace(begun, start=None, told_confidence=replay_of(line_of(begun).encode()).start_confidence)
    name = truth.persons[0].name
    for first in (begun, kept):
        doubts, series = after_all([first, later, *others]), Series(truth)
        series.add(first)
        series.add(later)
        words = f"{name}'s start pose is more likely wrong than right (confidence 0.03), of 4 frames"
        assert doubts.sentence().startswith(words) == told
        assert doubts.none == (not doubtful)
        expected = {"frame": first.frame.index, "confidence": round(begun.start_confidence[0], 3)}
        assert series.summary()["starts"] == {name: expected}


@pytest.mark.parametrize(("given", "n_views", "told"), [(False, 2, True), (True, 2, False), (False, 4, False)])
def test_of_two_cameras_face_to_face_a_run_says_that_they_do_not_tell_who_faces_where(
    truth: Scene, observation: Observation, given: bool, n_views: int, told: bool
) -> None:
    """However well the pose explains them; not of a pose that somebody gave, nor with cameras from other sides."""
    names = truth.rig.names[::2] if n_views == 2 else truth.rig.names
    estimate = in_doubt(estimate_of(truth, observation))
    (begun,) = steps_of(truth, observation, [[estimate]])
    q, scene = truth.persons[0].q, replace(truth, rig=truth.rig.select(names))
    one = Hypothesis(q, 1.0, 1.0, 0.0, 0.0, given=given)
    begun = replace(begun, scene=scene, start=Start((q,), hypotheses=((one,),), sureness=(1.0,)))
    doubts = Doubts().after(begun)
    assert ("do not tell who faces where" in doubts.sentence()) == told == (not doubts.none)
    assert begun.start_confidence == pytest.approx((FACES_RIGHTLY if told else 1.0,))
    kept = replay_of(line_of(begun).encode())
    again = replace(begun, start=None, told_confidence=kept.start_confidence, told_unfaced=kept.unfaced)
    assert Doubts().after(again).sentence() == doubts.sentence(), "also when a run is resumed"


@given(st.sets(st.integers(0, 60)))
def test_ranges_are_the_numbers_in_few_words(numbers: set[int]) -> None:
    found = ranges(numbers)
    assert {n for first, last in found for n in range(first, last + 1)} == numbers
    assert all(one[1] + 1 < other[0] for one, other in pairwise(found))


def test_much_doubt_asks_about_the_input(truth: Scene, observation: Observation) -> None:
    """However it comes together; a hard stretch does not, nor a single limb throughout."""
    sure = in_doubt(estimate_of(truth, observation))
    arm, arms = in_doubt(sure, "left_arm"), in_doubt(sure, "left_arm", "right_arm")
    hard = [[replace(sure, status=Status.LOST)]] * 2 + [[in_doubt(sure, whole=True)]] * 2
    assert after_all(steps_of(truth, observation, [[sure], *hard, *[[arms]] * 2, *[[sure]] * 3])).advice() == ""
    told = after_all(steps_of(truth, observation, [[sure], *hard, *[[arms]] * 3, *[[sure]] * 2])).advice()
    assert told.startswith("7 of 10 frames in doubt")
    assert "reading.occluders" in told
    assert "views are exchanged" in told
    assert "more cameras" not in told
    assert after_all(steps_of(truth, observation, [[arm]] * 10)).advice() == ""
    assert after_all(steps_of(truth, observation, [[arm, arm]] * 10)).advice() == "", "one limb each"
    assert Doubts().advice() == ""
    assert "film with more cameras" in Doubts(10, n_views=2, grave=tuple(range(10))).advice()


def test_of_several_persons_it_is_said_who_is_lost_or_doubtful(truth: Scene, observation: Observation) -> None:
    sure = in_doubt(estimate_of(truth, observation))
    lost, unsure = replace(sure, status=Status.LOST), in_doubt(sure, whole=True)
    name, rows = truth.persons[0].name, [(sure, sure), (sure, lost), (unsure, lost), (sure, lost), (unsure, sure)]
    assert after_all(steps_of(truth, observation, rows)).sentence() == (
        f"of 5 frames {name} doubtful in 2 (frames 2, 4), other lost in 3 (frames 1-3)"
    )


def test_views_without_images_are_named(truth: Scene, observation: Observation) -> None:
    sure = in_doubt(estimate_of(truth, observation))
    steps = steps_of(truth, observation, [[sure]] * 4)
    steps[2:] = [replace(step, frame=replace(step.frame, images=(*IMAGES[:3], None))) for step in steps[2:]]
    told = after_all(steps).sentence()
    assert told.endswith(f"ambiguous limb; {truth.rig.names[3]} missing in 2 (frames 2-3)")


def test_of_who_is_lost_no_limb_is_ambiguous(truth: Scene, observation: Observation) -> None:
    """Tables, counts and the terminal would disagree."""
    why = Doubt("", Because.NOT_FOUND)
    lost = in_doubt(estimate_of(truth, observation), "left_arm", whole=True).losing(why)
    assert (lost.ambiguous, lost.vague, lost.lost, lost.doubts[0]) == ((), (), True, why)
    assert lost.doubting((Doubt("left_leg", Because.JUMP),)) is lost


def test_frames_before_anybody_has_come_in_ask_nothing(truth: Scene, observation: Observation) -> None:
    sure = in_doubt(estimate_of(truth, observation))
    lost, doubts = replace(sure, status=Status.LOST), Doubts()
    fitted = objective_of(truth, observation).asked.fine(truth.persons[0].q)
    frames = [lost] * 8 + [sure] * 2 + [lost] * 2
    for k, estimate in enumerate(frames):
        doubts = doubts.after(Step(Frame(k, 0.04 * k, (None,) * 4), truth, (estimate,), fitted))
    assert (doubts.n_before, len(doubts.lost), doubts.advice()) == (8, 10, "")
    for k in range(12, 16):
        doubts = doubts.after(Step(Frame(k, 0.04 * k, (None,) * 4), truth, (lost,), fitted))
    assert doubts.advice().startswith("6 of 8 frames in doubt"), "whoever has left is asked about"


def test_who_comes_in_later_asks_nothing_about_the_others(truth: Scene, observation: Observation) -> None:
    sure = in_doubt(estimate_of(truth, observation))
    lost, doubts = replace(sure, status=Status.LOST), Doubts()
    both = replace(truth, persons=(truth.persons[0], replace(truth.persons[0], name="other")))
    fitted = objective_of(truth, observation).asked.fine(truth.persons[0].q)
    for k, pair in enumerate([(sure, lost)] * 8 + [(sure, sure)] * 2):
        doubts = doubts.after(Step(Frame(k, 0.04 * k, (None,) * 4), both, pair, fitted))
    assert (len(doubts.lost), doubts.n_before, doubts.advice()) == (8, 0, "")
    for k in range(10, 20):
        doubts = doubts.after(Step(Frame(k, 0.04 * k, (None,) * 4), both, (lost, sure), fitted))
    assert doubts.advice() == "", "ten of twenty"
    for k in range(20, 25):
        doubts = doubts.after(Step(Frame(k, 0.04 * k, (None,) * 4), both, (lost, sure), fitted))
    assert doubts.advice() == "", "15 of 25"
    doubts = doubts.after(Step(Frame(25, 1.0, (None,) * 4), both, (lost, sure), fitted))
    assert doubts.advice().startswith("16 of 26 frames in doubt")


def test_the_overlay_says_whose_limbs_are_ambiguous(truth: Scene, observation: Observation) -> None:
    sure = in_doubt(estimate_of(truth, observation))
    arms = in_doubt(sure, "right_arm", "left_arm")
    both = replace(truth, persons=(truth.persons[0], replace(truth.persons[0], name="other")))
    fitted = objective_of(truth, observation).asked.fine(truth.persons[0].q)
    frame = Frame(3, 0.12, (None,) * 4)
    assert states_of(Step(frame, truth, (arms,), fitted)) == [
        "frame 3   0.12 s   tracked, ambiguous: left arm, right arm"
    ]
    lost = replace(arms, status=Status.LOST)
    told = states_of(Step(frame, both, (arms, lost), fitted))
    assert told == [
        "frame 3   0.12 s",
        f"{truth.persons[0].name}: tracked, ambiguous: left arm, right arm",
        "other: lost",
    ]


def test_doubt_is_written_to_the_tables(truth: Scene, observation: Observation, tmp_path: Path) -> None:
    found = estimate_of(truth, observation, left_arm_abduction=60.0)
    found, doubtful = in_doubt(found, "left_arm"), in_doubt(found, "left_arm", whole=True)
    context = RunContext("test", tmp_path, truth, fps=25.0, n_frames=2, interval_s=0.04)
    recorder = CsvTable().begin(context)
    fitted = objective_of(truth, observation).asked.fine(truth.persons[0].q)
    for k, estimate in enumerate((found, doubtful)):
        recorder.write(Step(Frame(k, 0.04 * k, (None,) * 4), truth, (estimate,), fitted))
    recorder.finish()
    with (tmp_path / "poses.csv").open(newline="") as file:
        poses = list(csv.DictReader(file))
    assert [(row["status"], row["ambiguous"]) for row in poses] == [("tracked", "left_arm"), ("doubtful", "left_arm")]
    with (tmp_path / "doubts.csv").open(newline="") as file:
        doubts = list(csv.reader(file))
    assert doubts[0] == ["frame", "time_s", "person", "limb", "because", "value", "limit"]
    name, measured = truth.persons[0].name, ["0.10000", "0.20000"]
    assert doubts[1:] == [
        ["0", "0.000000", name, "left_arm", "left_over", *measured],
        ["1", "0.040000", name, "", "left_over", "0.40000", "0.25000"],
        ["1", "0.040000", name, "left_arm", "left_over", *measured],
    ]
    with (tmp_path / "joints.csv").open(newline="") as file:
        joints = {(row["frame"], row["joint"]): row["status"] for row in csv.DictReader(file)}
    assert joints["0", "left_elbow"] == "ambiguous"
    assert joints["0", "right_elbow"] == "tracked"
    assert joints["1", "left_elbow"] == joints["1", "right_elbow"] == "doubtful"


def test_an_ambiguous_limb_is_not_learned_from(truth: Scene, observation: Observation) -> None:
    body = truth.persons[0].body
    found = in_doubt(estimate_of(truth, observation), "left_arm")
    for view in trusted_parts(body, found):
        np.testing.assert_array_equal(view, ~body.parts_of("left_arm"))
    for doubtful in (in_doubt(found, whole=True), replace(found, status=Status.LOST)):
        assert not trusted_parts(body, doubtful).any()


def looked_for(estimate: Estimate, n_frames: int, rule: LossRule) -> list[int]:
    """The frames in which a person is looked for anew whose estimate is the same in all of them."""
    troubles, found = Troubles(), list[int]()
    for n in range(n_frames):
        if sought_anew(estimate, troubles, rule):
            found.append(n)
        troubles = troubles.after(estimate, rule)
    return found


def test_who_is_lost_for_long_is_looked_for_more_seldom(truth: Scene, observation: Observation) -> None:
    lost = replace(estimate_of(truth, observation), status=Status.LOST)
    assert looked_for(lost, 100, LossRule()) == [0, 3, 9, 21, 45, 69, 93]
    assert looked_for(lost, 16, LossRule(restart_every=1)) == [0, 1, 3, 7, 15]


def test_for_a_single_limb_nobody_is_looked_for_anew(truth: Scene, observation: Observation) -> None:
    sure = estimate_of(truth, observation)
    limb, limbs = in_doubt(sure, "left_arm"), in_doubt(sure, "left_arm", "right_leg")
    for one, looked in ((sure, []), (limb, []), (limbs, [4, 9, 34]), (in_doubt(sure, whole=True), [4, 9, 34])):
        assert looked_for(one, 40, LossRule()) == looked


def test_a_limb_whose_place_nothing_tells_is_told_and_not_searched(truth: Scene, observation: Observation) -> None:
    """Joints known to 20 cm along one direction, and to 2 cm."""
    body = truth.persons[0].body
    right = estimate_of(truth, observation)
    turning = body.index("left_arm_abduction")
    marks = body.landmarks_in_world(right.q)
    ends = np.array([mark.parameter for mark in body.landmarks])
    metres = np.linalg.norm(body.point_jacobian(right.q, marks, ends)[:, :, turning], axis=1).max()
    for off_m, vague in ((0.2, ("left_arm",)), (0.02, ())):
        covariance = 1e-8 * np.eye(body.dof)
        covariance[turning, turning] = (off_m / metres) ** 2
        found = judged(body, replace(right, covariance=covariance), LossRule())
        assert limb_spreads_m(body, found)["left_arm"] == pytest.approx(off_m, rel=1e-3)
        assert (found.ambiguous, found.vague, found.limbs_in_doubt) == (vague, vague, ())
        assert not doubted(found)
        assert trusted_parts(body, found).all()
        told = {doubt.limb: doubt.value for doubt in found.doubts if doubt.because is Because.IMPROBABLE}
        assert told == {limb: p for limb, p in limb_probabilities(body, found).items() if p < 0.5}
        assert judged(body, found, LossRule(improbable_below=0.0)).ambiguous == ()
    again = judged(body, replace(right, covariance=np.eye(body.dof)), LossRule())
    again = again.doubting(Doubt(limb, Because.JUMP) for limb in ("left_arm", "left_leg"))
    assert set(again.ambiguous) == {"left_arm", "right_arm", "left_leg", "right_leg"}
    assert set(again.limbs_in_doubt) == {"left_arm", "left_leg"}
    assert doubted(again)
    nothing = judged(body, replace(right, covariance=np.full((body.dof, body.dof), np.nan)), LossRule())
    assert nothing.ambiguous == ()


def test_the_place_of_a_small_bodys_limb_is_told_by_its_size(truth: Scene, observation: Observation) -> None:
    """A hand's finger known to 3 cm may be anywhere; a person's arm is rather there."""
    right, told = estimate_of(truth, observation), {}
    for factor in (0.1, 0.6, 1.0):
        body = enlarged(truth, factor).persons[0].body
        q = np.where(body.rotates, right.q, factor * right.q)
        covariance = np.diag(np.where(body.rotates, 1e-3, 1e-8))
        scale = (0.03 / limb_spreads_m(body, replace(right, q=q, covariance=covariance))["left_arm"]) ** 2
        found = judged(body, replace(right, q=q, covariance=scale * covariance), LossRule())
        told[factor] = "left_arm" in found.vague
    assert told == {0.1: True, 0.6: False, 1.0: False}


def test_why_nobody_was_found_is_said_of_whole_recordings_without_anybody() -> None:
    """Of a few frames, too few for a start that fails to be an error, all are lost."""
    simulation = small_simulation("two_elbow_rotation", n_frames=2)
    dark = with_images(simulation, lambda t, v, image: np.zeros_like(image))
    cycle = replace(cycle_for(simulation), plates=(None,) * 4)
    told = after_all(list(track(dark, simulation.scene, cycle))).sentence()
    assert told.startswith("of 2 frames 2 lost (frames 0-1), nobody was found: frame 1: ")
    found = after_all(list(track(simulation.frames(), simulation.scene, cycle_for(simulation, TrueStart(simulation)))))
    assert "nobody" not in found.sentence()
