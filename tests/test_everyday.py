"""Everyday movements are themselves with another body, posture, tempo and extent; limbs that move count more."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from known_movements import LIBRARY, known

from tracker.bodies.body.description import load_body
from tracker.foundation.resources import model_path
from tracker.results.recognition import FEATURES, course_of
from tracker.results.recognition._packed import Rule, weights_of
from tracker.results.recognition.matching import recognize

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))
from benchmarks.everyday import everyday

BODY = load_body(model_path("human"))


@pytest.mark.parametrize("name", ["bow", "clap", "drink", "lunge", "point", "wave"])
@pytest.mark.parametrize(("tempo", "size"), [(0.8, 1.2), (1.25, 0.8)])
def test_a_movement_of_another_person_is_itself(name, tempo, size):
    one, rng = everyday()[name], np.random.default_rng(7)
    times = np.arange(0.0, (3 if one.repeats else 1) * one.seconds / tempo, 0.04)
    poses = one.poses(BODY, times * tempo)
    usual = poses.mean(axis=0) if one.repeats else poses[0]
    posture = np.radians(3.0) * rng.standard_normal(BODY.dof) * BODY.rotates
    found = recognize(course_of(BODY, times, BODY.clamped(usual + size * (poses - usual) + posture)), LIBRARY)
    assert {told.movement for told in found} == {name}


def test_limbs_count_by_how_far_they_move():
    rule, directions = Rule(), known("point")
    weights = dict(zip(FEATURES, weights_of(directions, rule), strict=True))
    assert sum(weights.values()) == pytest.approx(1, abs=1e-6)
    assert sorted(weights, key=weights.__getitem__)[-2:] in (
        ["right_forearm", "right_upper_arm"],
        ["right_upper_arm", "right_forearm"],
    )
    still = weights_of(np.repeat(directions[:1], 9, axis=0), rule)
    np.testing.assert_allclose(still, 1 / len(FEATURES), rtol=1e-3)
