"""The bounded step of a fit against scipy's bounded least squares, and the conditions of a minimum."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import lsq_linear

from tracker.acquisition.fitting import bounded_step


@settings(max_examples=60, deadline=None)
@given(n=st.integers(1, 30), seed=st.integers(0, 10**6), tightness=st.floats(0.01, 3), condition=st.floats(0, 6))
def test_the_step_is_that_of_bounded_least_squares(n: int, seed: int, tightness: float, condition: float) -> None:
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(n, n)))[0]
    matrix = (turn * 10 ** rng.uniform(-condition / 2, condition / 2, n)) @ turn.T
    matrix = (matrix + matrix.T) / 2
    vector = rng.normal(size=n)
    lower = np.where(rng.random(n) < 0.2, -np.inf, -tightness * rng.random(n))
    upper = np.where(rng.random(n) < 0.2, np.inf, tightness * rng.random(n))
    found = bounded_step(matrix, vector, lower, upper)
    assert ((found >= lower) & (found <= upper)).all()
    factor = cholesky(matrix)
    target = -solve_triangular(factor, vector, trans="T")
    wanted = lsq_linear(factor, target, (lower, upper), method="bvls", max_iter=500, tol=1e-15).x
    cost, least = (float(x @ matrix @ x / 2 + vector @ x) for x in (found, wanted))
    assert cost <= least + 1e-9 * (1 + abs(least))
    np.testing.assert_allclose(found, wanted, atol=1e-6 * (1 + np.abs(wanted).max()) * 10 ** (condition / 2))


def test_a_step_without_bounds_in_its_way_is_that_of_newton() -> None:
    matrix, vector = np.array([[4.0, 1.0], [1.0, 3.0]]), np.array([1.0, -2.0])
    found = bounded_step(matrix, vector, np.full(2, -9.0), np.full(2, 9.0))
    assert found == pytest.approx(-np.linalg.solve(matrix, vector), rel=1e-12)
