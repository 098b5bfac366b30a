"""What keypoints changed in a run: told at its end, and in its report."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from detected import detected, written
from recordings import small_simulation

from tracker.evidence.contours import ContourEvidence
from tracker.evidence.keypoints import KeypointEvidence, ObservedKeypoints
from tracker.evidence.measures.account import Account, summed
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.together import TogetherEvidence
from tracker.running.jobs import execute, load_job
from tracker.running.jobs._messages import KeypointShare
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Recipe, write_sequence

LIMIT = 0.3


def account_of(n_parts: int, left_over: np.ndarray) -> Account:
    """Of images: 100 px of every part are visible, and a share of each is left over."""
    visible = np.full(n_parts, 100.0)
    nothing = np.zeros(n_parts)
    return Account(1.0, np.ones(4), np.ones(n_parts), visible, (1 - left_over) * visible, nothing)


@pytest.mark.parametrize(
    ("images_left_over", "keypoints_off", "words"),
    [
        (0.45, False, "without them 1 limb in 1 of 1 frames (left_arm 1) would be in doubt"),
        (0.1, False, "no limb would be in doubt without them"),
        (0.1, True, "1 limb in 1 of 1 frames (left_arm 1) are in doubt by them alone"),
    ],
)
def test_limbs_whose_verdict_keypoints_decide_are_counted(
    images_left_over: float, keypoints_off: bool, words: str, tmp_path: Path
) -> None:
    simulation = small_simulation(n_frames=1)
    frame, scene = next(simulation.frames()), simulation.scene.with_poses((simulation.poses[0][0],))
    person, views = scene.persons[0], detected(scene)
    if keypoints_off:
        for view in views:
            view[:, [7, 9], :2] += 60  # left elbow and wrist in COCO's order
    keypoints = KeypointEvidence(path=written(views, scene.rig.names, tmp_path))
    left_over = np.zeros(len(person.body.parts))
    left_over[person.body.parts_of("left_arm")] = images_left_over
    observed = ObservedKeypoints(replace(frame, images=(None,) * 4), (True,) * 4)
    own = keypoints.account(Comparison(scene, 0, CpuSynthesis(), observed), person.q)
    both = summed([account_of(len(left_over), left_over), own], (1.0, 1.0))
    estimate = SimpleNamespace(q=person.q, lost=False, account=both)
    step: Any = SimpleNamespace(
        frame=frame, scene=scene, estimates=(estimate,), start=SimpleNamespace(by_keypoints=True)
    )
    share = KeypointShare(TogetherEvidence(of=(ContourEvidence(), keypoints), refining=(1.0, 1.0)), LIMIT)
    assert list(share.kept([step])) == [step]
    assert words in share.told()
    assert share.told().startswith("keypoints: the start in frame 0 is theirs; ")


def test_a_run_without_keypoints_tells_nothing_of_them() -> None:
    share = KeypointShare(ContourEvidence(), LIMIT)
    assert list(share.kept([])) == []
    assert share.told() == ""


def test_a_run_says_at_its_end_and_in_its_report_what_keypoints_changed(tmp_path: Path) -> None:
    recipe = Recipe("arm_swing", seconds=0.12, size=(180, 144))
    config = write_sequence(recipe, tmp_path / "sequence")
    simulation = small_simulation(n_frames=3, size=recipe.size)
    for t, q in enumerate(simulation.poses[0]):
        scene = simulation.scene.with_poses((q,))
        pattern = written(detected(scene), scene.rig.names, tmp_path / "sequence", t)
    few = ["passes=1", "inspection=false", 'recordings=["run_json","journal","report"]']
    outcome = execute(load_job("track", config, [f'keypoints.path="{pattern}"', *few]), tmp_path / "out")
    assert outcome.keypoints.startswith("keypoints: the start in frame 0 is theirs; ")
    assert json.loads((tmp_path / "out" / "run.json").read_text())["keypoints"] == [outcome.keypoints]
    assert outcome.keypoints[1:] in (tmp_path / "out" / "report.html").read_text()
