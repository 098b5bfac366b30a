"""Colour tables: bins, learning and posteriors against plain twins."""

from __future__ import annotations

import numpy as np
import pytest
from painted import colour_numbers, scattered_tables
from scipy.ndimage import convolve1d

from tracker._native import learn_colours
from tracker.kernels.regions import EVEN, HIDDEN, N_COLOURS, encode, tabulate_posteriors


def test_encoding_gives_the_bins_of_a_picture() -> None:
    picture = np.random.default_rng(0).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    codes = np.zeros(7 * 5, dtype=np.uint16)
    encode(picture, codes)
    assert (codes == colour_numbers(picture, np.stack(np.meshgrid(range(7), range(5)), axis=-1)).ravel()).all()


def test_learning_is_a_running_mean_of_smoothed_shares() -> None:
    rng = np.random.default_rng(1)
    counts = rng.integers(0, 4, N_COLOURS) * (rng.uniform(size=N_COLOURS) < 0.1)
    smooth = counts.reshape(16, 16, 16) / counts.sum()
    for axis in range(3):
        smooth = convolve1d(smooth, [0.25, 0.5, 0.25], axis=axis, mode="nearest")
    table = np.zeros(N_COLOURS, dtype=np.float32)
    assert learn_colours(counts, 0.15, table)
    np.testing.assert_allclose(table, smooth.ravel(), atol=1e-7)
    other = np.roll(counts, 333)
    before = table.copy()
    assert learn_colours(other, 0.15, table)
    fresh = np.zeros(N_COLOURS, dtype=np.float32)
    learn_colours(other, 0.15, fresh)
    np.testing.assert_allclose(table, 0.85 * before + 0.15 * fresh, atol=1e-7)
    assert table.sum() == pytest.approx(1, abs=1e-5)


def test_a_handful_of_pixels_teaches_nothing() -> None:
    counts, table = np.zeros(N_COLOURS, dtype=np.int64), np.zeros(N_COLOURS, dtype=np.float32)
    counts[7] = 19
    assert not learn_colours(counts, 0.15, table)
    assert not table.any()


def test_posteriors_are_bounded_odds() -> None:
    tables = scattered_tables(2, 3)
    wanted = np.ones((2, 3), dtype=np.bool_)
    wanted[1, 1] = False
    posteriors = np.full((2, 3, N_COLOURS), 77, dtype=np.uint8)
    tabulate_posteriors(tables, (2e-4, 4.0), wanted, posteriors)
    odds = np.clip(np.log((tables.inside + 2e-4) / (tables.outside + 2e-4)), -4, 4)
    expected = 254 / (1 + np.exp(-odds))
    assert np.abs(posteriors - expected)[wanted].max() <= 0.51
    assert (posteriors[1, 1] == 77).all()


def test_colours_of_a_hider_are_those_that_the_part_has_not() -> None:
    tables = scattered_tables(2, 1)
    tables.inside[0, 0, :3] = 0.0, 0.01, 0.01
    tables.hiders[0, :3] = 0.02, 0.02, 0.04
    posteriors = np.full((2, 1, N_COLOURS), EVEN, dtype=np.uint8)
    tabulate_posteriors(tables, (2e-4, 4.0), np.ones((2, 1), dtype=np.bool_), posteriors)
    np.testing.assert_array_equal(posteriors[0, 0, :3] == HIDDEN, [True, False, True])
    assert np.count_nonzero(posteriors == HIDDEN) == 2
