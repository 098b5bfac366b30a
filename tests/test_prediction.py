"""Prediction: exact on polynomials, the least-squares fit of the last frames, and what enters the history."""

from __future__ import annotations

import numpy as np
import pydantic
import pytest
from recordings import around
from rounding import assert_alike
from sections import each, made

from tracker.bodies.body import BodyModel
from tracker.evidence.measures.account import Account
from tracker.foundation.arrays import Array
from tracker.tracking.estimate import Estimate, Status
from tracker.tracking.prediction.polynomial import PolynomialPrediction
from tracker.tracking.trajectory import KEPT, History

DT = 0.04


def middle_of(body: BodyModel) -> Array:
    """(dof,) far from all limits."""
    low, high = body.limits.T
    inside: Array = (np.clip(low, -1, 1) + np.clip(high, -1, 1)) / 2
    return inside


def polynomial(body: BodyModel, degree: int, times: Array, seed: int = 0) -> Array:
    """(T, dof) slow polynomials of that degree around the middle of the limits."""
    rng = np.random.default_rng(seed)
    phase = times - times[0]
    powers = np.stack([phase**k for k in range(degree + 1)], axis=1)
    return middle_of(body) + powers @ rng.uniform(-0.2, 0.2, (degree + 1, body.dof))


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
@pytest.mark.parametrize("gap", [1, 2, 4])
@pytest.mark.parametrize("start_s", [0.0, 86400.0])
def test_a_polynomial_is_continued_exactly(body: BodyModel, degree: int, gap: int, start_s: float) -> None:
    """Over missing frames too, and a day after the start."""
    times = start_s + DT * np.array([0, 1, 2, 3, 4, 5, 6, 6 + gap])
    poses = polynomial(body, degree, times)
    prediction = PolynomialPrediction(degree=degree, candidates=False)
    found = prediction.predict(body, History(times[:-1], poses[:-1]), float(times[-1]))
    assert found.shape == (1, body.dof)
    np.testing.assert_allclose(found[0], poses[-1], atol=1e-8)


def test_unevenly_spaced_frames_are_no_obstacle(body: BodyModel) -> None:
    times = np.array([0.0, 0.04, 0.16, 0.2, 0.24, 0.4, 0.5])
    poses = polynomial(body, 2, times)
    found = PolynomialPrediction().predict(body, History(times[:-1], poses[:-1]), 0.5)
    np.testing.assert_allclose(found[0], poses[-1], atol=1e-10)


def test_candidates_are_least_squares_fits_of_every_degree(body: BodyModel) -> None:
    """The oracle is NumPy's polynomial fit of the last frames only."""
    times = DT * np.arange(12)
    poses = middle_of(body) + np.random.default_rng(1).normal(0, 0.02, (12, body.dof))
    found = PolynomialPrediction(window=6, velocity_window=4).predict(body, History(times, poses), 12 * DT)
    expected = []
    for degree, window in ((2, 6), (1, 4)):
        fits = np.polynomial.polynomial.polyfit(times[-window:], poses[-window:], degree)
        expected.append(np.polynomial.polynomial.polyval(12 * DT, fits))
    np.testing.assert_allclose(found, [*expected, poses[-1]], atol=1e-9)


@pytest.mark.parametrize(("n_frames", "n_candidates"), [(1, 1), (2, 2), (3, 3), (9, 3)])
def test_short_histories_support_low_degrees(body: BodyModel, n_frames: int, n_candidates: int) -> None:
    times = DT * np.arange(n_frames + 1)
    poses = polynomial(body, n_candidates - 1, times)
    found = PolynomialPrediction().predict(body, History(times[:-1], poses[:-1]), float(times[-1]))
    assert found.shape == (n_candidates, body.dof)
    np.testing.assert_allclose(found[0], poses[-1], atol=1e-10)
    assert_alike(found[-1], poses[-2])
    only = PolynomialPrediction(candidates=False).predict(body, History(times[:-1], poses[:-1]), float(times[-1]))
    assert_alike(only, found[:1])


def test_a_window_too_short_for_the_degree_is_widened(body: BodyModel) -> None:
    times = DT * np.arange(7)
    poses = polynomial(body, 2, times)
    found = PolynomialPrediction(window=1).predict(body, History(times[:-1], poses[:-1]), float(times[-1]))
    np.testing.assert_allclose(found[0], poses[-1], atol=1e-10)


def test_units_and_origin_of_time_do_not_matter(body: BodyModel) -> None:
    times = DT * np.arange(9)
    poses = middle_of(body) + np.random.default_rng(2).normal(0, 0.02, (9, body.dof))
    one = PolynomialPrediction().predict(body, History(times, poses), 9 * DT)
    other = PolynomialPrediction().predict(body, History(1000 + 50 * times, poses), 1000 + 50 * 9 * DT)
    np.testing.assert_allclose(one, other, atol=1e-9)


def test_nobody_is_predicted_beyond_the_joint_limits(body: BodyModel) -> None:
    elbow, knee = body.index("left_arm_extension"), body.index("right_leg_extension")
    times = DT * np.arange(5)
    poses = np.tile(middle_of(body), (5, 1))
    poses[:, elbow] = 0.4 - 0.09 * np.arange(5)
    poses[:, knee] = body.limits[knee, 1] - 0.2 + 0.045 * np.arange(5)
    found = PolynomialPrediction().predict(body, History(times, poses), 6 * DT)
    np.testing.assert_allclose(found[:2, elbow], body.limits[elbow, 0])
    np.testing.assert_allclose(found[:2, knee], body.limits[knee, 1])
    others = np.setdiff1d(np.arange(body.dof), [elbow, knee])
    np.testing.assert_allclose(found[:, others], poses[:3, others], atol=1e-12)


def test_constant_acceleration_amplifies_noise_as_theory_says(body: BodyModel) -> None:
    """Extrapolating a parabola over 5 frames by one frame: sigma^2 a^T (A^T A)^-1 a with a = (1, 1, 1)."""
    rng, times, sigma = np.random.default_rng(3), DT * np.arange(5), 0.005
    design = np.vander(np.arange(-4, 1), 3)
    theory = sigma * np.sqrt(np.ones(3) @ np.linalg.inv(design.T @ design) @ np.ones(3))
    runs = [middle_of(body) + rng.normal(0, sigma, (5, body.dof)) for _ in range(400)]
    found = np.array([PolynomialPrediction().predict(body, History(times, poses), 5 * DT)[0] for poses in runs])
    errors = (found - middle_of(body))[:, body.rotates]
    # 400 runs of 19 independent angles: the spread is known to 1 %
    assert errors.std() == pytest.approx(theory, rel=0.05)


def estimate(q: Array, status: Status) -> Estimate:
    nothing = np.zeros(0)
    account = Account(1.0, nothing, nothing, nothing, nothing, nothing)
    return Estimate(q, np.zeros((len(q), len(q))), account, 0.0, 1, status=status)


def test_history_grows_with_what_is_tracked_and_forgets_the_oldest() -> None:
    history = History.start(0.0, np.zeros(3))
    for k in range(1, 8):
        history = history.after(DT * k, estimate(np.full(3, float(k)), Status.TRACKED), window=5)
    np.testing.assert_allclose(history.times, DT * np.arange(3, 8))
    np.testing.assert_array_equal(history.poses, np.tile(np.arange(3.0, 8)[:, None], 3))


def test_a_loss_leaves_the_history_and_a_recovery_begins_a_new_one() -> None:
    history = History.start(0.0, np.zeros(3)).after(DT, estimate(np.ones(3), Status.TRACKED))
    assert history.after(2 * DT, estimate(np.full(3, 9.0), Status.LOST)) is history
    for status in (Status.RECOVERED, Status.BOOTSTRAPPED):
        fresh = history.after(3 * DT, estimate(np.full(3, 5.0), status))
        np.testing.assert_array_equal(fresh.times, [3 * DT])
        np.testing.assert_array_equal(fresh.poses, [[5.0, 5.0, 5.0]])
    assert len(history.times) == 2


@each("prediction")
@pytest.mark.parametrize("n_frames", [1, 2, 3, 12])
def test_predictions_are_possible_poses(use, n_frames, truth):
    body = truth.persons[0].body
    history = History(0.04 * np.arange(n_frames), around(truth, n_frames, 40.0, 0.5))
    candidates = made("prediction", use).predict(body, history, 0.04 * n_frames)
    assert candidates.shape == (len(candidates), body.dof)
    assert len(candidates) >= 1
    np.testing.assert_array_equal(candidates, body.clamped(candidates))
    later = History(history.times + 100.0, history.poses)
    again = made("prediction", use).predict(body, later, 0.04 * n_frames + 100.0)
    np.testing.assert_allclose(again, candidates, atol=1e-8)


@each("prediction")
@pytest.mark.parametrize("n_frames", [1, 2, 12])
def test_who_stands_still_is_predicted_to(use, n_frames, truth):
    person = truth.persons[0]
    history = History(0.04 * np.arange(n_frames), np.tile(person.q, (n_frames, 1)))
    candidates = made("prediction", use).predict(person.body, history, 0.04 * n_frames)
    np.testing.assert_allclose(candidates, np.tile(person.q, (len(candidates), 1)), atol=1e-9)


@pytest.mark.parametrize("field", ["window", "velocity_window"])
def test_a_window_longer_than_the_history_is_refused(field: str) -> None:
    with pytest.raises(pydantic.ValidationError, match=field):
        PolynomialPrediction(**{field: KEPT + 1})
