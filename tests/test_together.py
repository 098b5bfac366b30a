"""Kinds of evidence together: one that knows the body so well that it leaves hardly anything over counts more."""

from __future__ import annotations

import numpy as np
import pytest

from tracker.evidence.measures.account import Account, summed
from tracker.evidence.measures.correspondences import Equations
from tracker.evidence.together import TogetherEvidence, _sharpened
from tracker.foundation.errors import ConfigError


def leaving(rms_px: float) -> Equations:
    return Equations(np.eye(2), np.zeros(2), squares=100 * rms_px**2, total=100.0)


@pytest.mark.parametrize(
    ("rms_px", "weights"),
    [
        ((2.0, 2.0), (0.3, 1.0)),
        ((1.2, 0.1), (0.3, 1.0)),
        ((0.6, 2.0), (1.0, 1.0 / 4.8)),
        ((1.0, 2.0), (0.3 * 1.2**4, 1.0)),
    ],
)
def test_what_fits_better_than_exact_counts_more(rms_px: tuple[float, ...], weights: tuple[float, ...]) -> None:
    found = _sharpened(np.array([0.3, 1.0]), [leaving(value) for value in rms_px], np.array([1.2, 0.0]))
    np.testing.assert_allclose(found, weights)


def test_what_says_nothing_is_not_exact() -> None:
    found = _sharpened(np.array([0.3, 1.0]), [Equations.nothing(2), leaving(2.0)], np.array([1.2, 0.0]))
    np.testing.assert_array_equal(found, [0.3, 1.0])


def test_every_kind_has_its_value() -> None:
    with pytest.raises(ConfigError, match="exact_px has 1 values for 2 kinds"):
        TogetherEvidence(exact_px=(1.2,))


def test_a_view_that_one_kind_tells_nothing_of_has_the_distance_of_the_others() -> None:
    none, px = np.zeros(2), np.ones(2)
    one = Account(3.0, np.array([3.0, np.nan]), px, px, px, none)
    other = Account(1.0, np.array([1.0, np.nan]), px, px, px, none)
    silent = Account(0.0, np.array([np.nan, np.nan]), px, none, none, none)
    found = summed([one, other, silent], [1.0, 2.0, 1.0])
    np.testing.assert_array_equal(found.per_view_px, [5.0, np.nan])
