"""Halton's sequence against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from rounding import assert_alike
from scipy.stats import qmc

from tracker.foundation.geometry import halton


@pytest.mark.parametrize(("n", "n_dimensions"), [(1, 1), (64, 6), (1000, 12)])
def test_points_are_scipys(n, n_dimensions):
    assert_alike(halton(n, n_dimensions), qmc.Halton(n_dimensions, scramble=False).random(n))


def test_the_first_points_are_halves_and_thirds():
    np.testing.assert_allclose(halton(4, 2), [[0, 0], [1 / 2, 1 / 3], [1 / 4, 2 / 3], [3 / 4, 1 / 9]], atol=1e-15)


def test_of_no_dimensions_there_is_nothing():
    assert halton(5, 0).shape == (5, 0)
