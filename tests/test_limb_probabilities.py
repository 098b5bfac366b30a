"""How probable limbs are: a worse image never raises it, and what is fitted is what was true."""

from __future__ import annotations

import importlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from doubted import estimate_of

from tracker.bodies.scene import Scene
from tracker.images.sight import Observation
from tracker.tracking.doubt import Because, Doubt
from tracker.tracking.limb_probabilities import FITTED, Known, limb_probabilities, right_by

SCRIPTS = str(Path(__file__).parents[1] / "scripts")


@pytest.fixture
def limb_fit(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(SCRIPTS)
    return importlib.import_module("benchmarks.limb_fit")


def drawn(n: int) -> tuple[Known, Any]:
    """Limbs as runs have them, each right as often as the odds say."""
    draw = np.random.default_rng(5)
    left_over, whole = np.abs(draw.normal(0, 0.25, n)), np.abs(draw.normal(0.1, 0.08, n))
    spread_m, stops, jumped = np.exp(draw.normal(np.log(0.02), 0.5, n)), draw.poisson(0.3, n), draw.random(n) < 0.1
    known = Known(left_over, whole, spread_m, stops.astype(float), jumped.astype(float))
    return known, draw.random(n) < right_by(FITTED, known)


def test_odds_are_found_again_from_limbs_that_follow_them(limb_fit: Any) -> None:
    """To the chance of 20 000 draws."""
    known, right = drawn(20_000)
    found = limb_fit.fitted(known, right)
    assert np.abs(right_by(found, known) - right_by(FITTED, known)).mean() < 0.01


def test_reliability_of_what_is_true_lies_on_the_diagonal(limb_fit: Any) -> None:
    """Each share to four of its standard deviations."""
    known, right = drawn(20_000)
    rows = limb_fit.reliability(right_by(FITTED, known), right)
    assert sum(n for _, _, n, _, _ in rows) == 20_000
    for _, _, n, told, share in rows:
        assert abs(told - share) < 4 * np.sqrt(told * (1 - told) / n) + 1 / n


def test_a_worse_image_never_makes_a_limb_more_probable(truth: Scene, observation: Observation) -> None:
    body, right = truth.persons[0].body, estimate_of(truth, observation)
    told = limb_probabilities(body, right)
    assert set(told) == set(body.limbs)
    assert all(0.9 < one <= 1 for one in told.values())
    arm = body.parts_of("left_arm")
    before = told
    for share in (0.3, 0.6, 1.0):
        missed_px = right.account.missed_px + share * np.where(arm, right.account.visible_px, 0.0)
        worse = replace(right, account=replace(right.account, missed_px=missed_px))
        now = limb_probabilities(body, worse)
        assert all(now[limb] <= before[limb] for limb in now)
        assert now["left_arm"] < before["left_arm"]
        before = now
    assert before["left_arm"] < 0.1 < 0.8 < before["right_leg"]
    vague = limb_probabilities(body, replace(right, covariance=0.01 * np.eye(body.dof)))
    assert all(vague[limb] < told[limb] for limb in told)


def test_a_jump_makes_its_limb_less_probable_and_no_other_one(truth: Scene, observation: Observation) -> None:
    body, right = truth.persons[0].body, estimate_of(truth, observation)
    told = limb_probabilities(body, right)
    jumped = limb_probabilities(body, right.doubting((Doubt("left_arm", Because.JUMP, 0.3, 0.1),)))
    assert jumped == told | {"left_arm": jumped["left_arm"]}
    assert jumped["left_arm"] < told["left_arm"]


def test_an_estimation_without_covariance_tells_probabilities_by_what_is_left_over(
    truth: Scene, observation: Observation
) -> None:
    right = estimate_of(truth, observation)
    unknown = replace(right, covariance=np.full_like(right.covariance, np.nan))
    body = truth.persons[0].body
    told, known = limb_probabilities(body, unknown), limb_probabilities(body, right)
    assert all(0.5 < told[limb] < known[limb] for limb in body.limbs)
