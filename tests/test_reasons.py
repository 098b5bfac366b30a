"""Each doubt has its reason, with what was measured, from the decision to the terminal, the tables and the journal."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from doubted import after_all, estimate_of, in_doubt, steps_of

from tracker.bodies.scene import Scene
from tracker.foundation.errors import SequenceError
from tracker.images.sight import Observation
from tracker.results.recording._journal_line import line_of, replay_of
from tracker.tracking.doubt import Because, Doubt
from tracker.tracking.limb_probabilities import limbs_left_over
from tracker.tracking.loss import LossRule, judged


def test_the_reason_of_a_doubt_is_measured(truth: Scene, observation: Observation) -> None:
    """With the value and the limit that the decision was made by; who is lost by it has lost that first."""
    found, rule = estimate_of(truth, observation, left_arm_abduction=60.0), LossRule()
    left_over = limbs_left_over(truth.persons[0].body, found.account)
    told = {doubt.limb: doubt for doubt in found.doubts if doubt.because is Because.LEFT_OVER}
    assert told["left_arm"] == Doubt("left_arm", Because.LEFT_OVER, left_over["left_arm"], rule.ambiguous_above)
    lost = judged(truth.persons[0].body, found, LossRule(lost_below=1.0))
    assert lost.doubts[0] == Doubt("", Because.UNEXPLAINED, found.account.explained, 1.0)
    assert lost.reasons == lost.doubts[:1]
    assert not replace(lost, doubts=lost.doubts[:1]).doubtful, "lost, and nothing else"


def test_a_limb_is_doubted_once_for_a_reason(truth: Scene, observation: Observation) -> None:
    jump = Doubt("left_arm", Because.JUMP, 0.3, 0.1)
    once = in_doubt(estimate_of(truth, observation), "left_arm", vague=True).doubting((jump,))
    assert (once.ambiguous, once.vague, once.limbs_in_doubt) == (("left_arm",), (), ("left_arm",))
    assert once.doubting((replace(jump, value=0.2),)) == once
    assert [doubt.because for doubt in once.doubts] == [Because.IMPROBABLE, Because.JUMP]


def test_the_last_line_says_why(truth: Scene, observation: Observation) -> None:
    sure = in_doubt(estimate_of(truth, observation))
    arm = sure.doubting((Doubt("left_arm", Because.IMPROBABLE, 0.1, 0.2),))
    gone = in_doubt(sure, whole=True).losing(Doubt("", Because.FEW_VIEWS, 1, 2))
    rows = [[sure], [arm], [arm], [gone], [arm.doubting((Doubt("left_arm", Because.JUMP, 0.3, 0.1),))]]
    assert after_all(steps_of(truth, observation, rows)).why() == (
        "4 of 5 frames in doubt: 3 left arm: it is more likely elsewhere than at its place, 1 left arm: it "
        "jumps from one frame to another, 1 lost: too few views show it"
    )
    name, pairs = truth.persons[0].name, [(arm, sure), (sure, gone)]
    assert after_all(steps_of(truth, observation, pairs)).why() == (
        f"2 of 2 frames in doubt: 1 {name}'s left arm: it is more likely elsewhere than at its place, 1 other lost: "
        "too few views show it"
    )
    assert after_all(steps_of(truth, observation, [[sure]])).why() == ""
    many = sure.doubting(
        Doubt(limb, Because.JUMP) for limb in ("left_arm", "right_arm", "left_leg", "right_leg", "head")
    )
    assert after_all(steps_of(truth, observation, [[many]])).why().endswith("another, ...")


def test_the_journal_keeps_the_reasons(truth: Scene, observation: Observation) -> None:
    found = in_doubt(estimate_of(truth, observation), "left_arm").doubting(
        (Doubt("head", Because.IMPROBABLE, 0.07, 0.06),)
    )
    lost = found.losing(Doubt("", Because.NOT_FOUND))
    for estimate in (found, lost):
        (step,) = steps_of(truth, observation, [[estimate]])
        assert replay_of(line_of(step).encode()).estimates[0].doubts == estimate.doubts


def test_a_line_from_before_reasons_were_kept_is_read(truth: Scene, observation: Observation) -> None:
    (step,) = steps_of(
        truth, observation, [[in_doubt(estimate_of(truth, observation), "left_arm", "head", whole=True)]]
    )
    line = json.loads(line_of(step))
    (old,) = line["estimates"]
    del old["doubts"]
    old |= {"doubtful": True, "ambiguous": ["left_arm", "head"], "vague": ["head"]}
    (found,) = replay_of(json.dumps(line).encode()).estimates
    assert (found.doubtful, found.ambiguous, found.vague) == (True, ("left_arm", "head"), ("head",))
    assert {doubt.because for doubt in found.doubts} == {Because.UNTOLD, Because.HARDLY_SEEN}
    old |= {"doubtful": False, "ambiguous": [], "status": "lost"}
    del old["vague"]
    assert replay_of(json.dumps(line).encode()).estimates[0].doubts == (Doubt("", Because.UNTOLD),)


@pytest.mark.parametrize(
    "row", [["", "whim", None, None], ["", "jump", 1e400, 0.1], ["", "jump"], ["", "jump", "far", 1]]
)
def test_a_doubt_that_cannot_be_is_no_line_of_a_journal(
    truth: Scene, observation: Observation, row: list[str | float | None]
) -> None:
    (step,) = steps_of(truth, observation, [[estimate_of(truth, observation)]])
    line = json.loads(line_of(step))
    line["estimates"][0]["doubts"] = [row]
    with pytest.raises((SequenceError, ValueError)):
        replay_of(json.dumps(line).encode())
