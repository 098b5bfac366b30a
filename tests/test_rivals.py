"""Two estimates of one frame made into one: what each has right is taken."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from observations import bent
from test_best_first import Landscape

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.bodies.limbs import taken_over
from tracker.foundation.arrays import Array
from tracker.foundation.resources import model_path
from tracker.tracking.estimate import Estimate
from tracker.tracking.objective import Objective
from tracker.tracking.verdict import weighed

LIMBS = "left_arm", "right_leg"


def swung(body: BodyModel, q: Array, limb: str) -> Array:
    """The pose with a limb 60 degrees elsewhere."""
    pose: Array = q.copy()
    pose[body.index(f"{limb}_elevation")] += np.radians(-60 if q[body.index(f"{limb}_elevation")] > 0 else 60)
    return body.clamped(pose)


def between_joints(body: BodyModel, truth: Array, px_per_m: float) -> Landscape:
    """The mean distance of the landmarks from where they are in truth."""
    right = body.landmarks_in_world(truth)

    def height(poses: Array) -> Array:
        return np.array([px_per_m * np.linalg.norm(body.landmarks_in_world(q) - right, axis=1).mean() for q in poses])

    return Landscape(body, height)


def estimate(landscape: Landscape, q: Array, variance: float) -> Estimate:
    return landscape.estimate(q, np.full((len(q), len(q)), variance), 5)


@pytest.fixture
def body() -> BodyModel:
    return load_body(model_path("gavrila22"))


@pytest.mark.parametrize("mine_first", [True, False])
def test_each_limb_is_taken_from_where_it_is_right(body: BodyModel, mine_first: bool) -> None:
    truth = bent(body)
    landscape = between_joints(body, truth, px_per_m=100.0)
    pair = [estimate(landscape, swung(body, truth, limb), k + 1.0) for k, limb in enumerate(LIMBS)]
    mine, rival = pair if mine_first else pair[::-1]
    found = weighed(cast("Objective", landscape), mine, rival)
    np.testing.assert_allclose(body.landmarks_in_world(found.q), body.landmarks_in_world(truth), atol=1e-3)
    assert found.evaluations == 5 + 2 + 2
    assert weighed(cast("Objective", landscape), replace(mine, search_s=3.0), rival).search_s == 3.0


def test_the_uncertainty_of_a_limb_comes_with_it(body: BodyModel) -> None:
    truth = bent(body)
    landscape = between_joints(body, truth, px_per_m=100.0)
    mine, rival = (estimate(landscape, swung(body, truth, limb), k + 1.0) for k, limb in enumerate(LIMBS))
    found = weighed(cast("Objective", landscape), mine, rival)
    best, other = sorted((mine, rival), key=lambda one: one.distance_px)
    wrong = LIMBS[0] if best is mine else LIMBS[1]
    columns = body.group(wrong)
    rest = np.setdiff1d(np.arange(body.dof), columns)
    np.testing.assert_array_equal(found.covariance[np.ix_(columns, columns)], other.covariance[0, 0])
    np.testing.assert_array_equal(found.covariance[np.ix_(rest, rest)], best.covariance[0, 0])
    assert not found.covariance[np.ix_(rest, columns)].any()


@pytest.mark.parametrize("px_per_m", [100.0, 1.0])
def test_what_is_not_clearly_better_changes_nothing(body: BodyModel, px_per_m: float) -> None:
    truth = bent(body)
    landscape = between_joints(body, truth, px_per_m)
    mine, rival = estimate(landscape, swung(body, truth, "left_arm"), 1.0), estimate(landscape, truth, 1.0)
    found = weighed(cast("Objective", landscape), mine, rival)
    np.testing.assert_array_equal(found.q, truth if px_per_m == 100.0 else mine.q)


def test_what_lies_nearby_is_one_place(body: BodyModel) -> None:
    """A pose a few centimetres off is taken as a whole, or not."""
    truth = bent(body)
    beside = truth.copy()
    beside[body.index("left_arm_elevation")] += np.radians(8)
    landscape = between_joints(body, truth, 100.0)
    mine, rival = estimate(landscape, beside, 1.0), estimate(landscape, truth, 2.0)
    found = weighed(cast("Objective", landscape), mine, rival)
    np.testing.assert_array_equal(found.q, truth)
    np.testing.assert_array_equal(found.covariance, rival.covariance)


@pytest.mark.parametrize("model", ["gavrila22", "human", "quadruped"])
def test_a_limb_taken_over_is_in_its_place_in_the_world(model: str) -> None:
    """Though the trunk is elsewhere: here 3 cm and 5 degrees."""
    body = load_body(model_path(model))
    other, group = body.rest(), next(group for group in body.fine_groups if body.partner_of(group))
    q = other.copy()
    q[0] += 0.03
    q[np.flatnonzero(body.rotates)[0]] += np.radians(5)
    q[body.group(group)] += 0.3
    q = body.clamped(q)
    pose = taken_over(body, q, other, group)
    marks = body.landmarks_of(group)
    gaps = np.linalg.norm(body.landmarks_in_world(pose)[marks] - body.landmarks_in_world(other)[marks], axis=1)
    before = np.linalg.norm(body.landmarks_in_world(q)[marks] - body.landmarks_in_world(other)[marks], axis=1)
    # the shoulder or hip itself stays where the trunk has it
    assert gaps[-1] < 0.4 * before[-1]
    rest = np.setdiff1d(np.arange(body.dof), body.group(group))
    np.testing.assert_array_equal(pose[rest], q[rest])
