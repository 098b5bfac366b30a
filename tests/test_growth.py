"""Growth of matches over the template, the neighbourhood filter, and the correction for curvature."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from textures import Waves, deformed, pixels_of, sensed

from tracker.foundation.arrays import frozen
from tracker.kernels.patches import HALF_PATCH, MATCHED, stretch
from tracker.points.surfaces import LeastSquaresMatching
from tracker.points.surfaces.growth import Growth, MatchField, corrected_for_curvature
from tracker.points.surfaces.points import NeighbourhoodFilter, voxel_members

SIZE = (160, 120)
AFFINE, SHIFT = np.array([[1.05, 0.02], [-0.03, 0.97]]), np.array([2.0, 3.0])
MATCHING = LeastSquaresMatching()


def images(blank=None):
    one, two = (
        deformed(Waves(8), SIZE, affine, shift, 1.0, key)
        for key, (affine, shift) in enumerate(((np.eye(2), np.zeros(2)), (AFFINE, SHIFT)))
    )
    if blank:
        two[blank] = 128
    return MATCHING.prepared(one), MATCHING.prepared(two)


def seeds(pair, *places):
    at = np.array(places, dtype=float)
    matches = MATCHING.match(*pair, at, at @ AFFINE.T + SHIFT)
    assert matches.good.all()
    return matches


def errors_of(field):
    at = field.at[field.matched]
    return np.linalg.norm(field.found[field.matched, :2] - (at @ AFFINE.T + SHIFT), axis=1)


@pytest.mark.parametrize("order", ["best_first", "rows"])
@pytest.mark.parametrize("step", [2, 5])
def test_one_seed_covers_what_both_images_show(order, step):
    pair, told = images(), []
    field = Growth(step_px=step, order=order).grown(
        MATCHING, pair, seeds(pair, (60, 60)), lambda what, n, total: told.append(n)
    )
    at = field.at
    places = at @ AFFINE.T + SHIFT
    # A patch of 13 px, stretched, and the two pixels that the splines need
    inner = ((at >= 8) & (at <= np.array(SIZE) - 9)).all(axis=1)
    inner &= ((places >= 10) & (places <= np.array(SIZE) - 11)).all(axis=1)
    assert field.matched[inner].all()
    assert not field.matched[(at < 8).any(axis=1)].any()
    assert errors_of(field).max() < 0.05
    assert told[-1] == field.matched.sum()


def test_growth_stays_in_its_rectangle():
    pair = images()
    field = Growth(step_px=4, region=(40, 30, 100, 90)).grown(MATCHING, pair, seeds(pair, (60, 60)))
    inside = ((field.at >= (40, 30)) & (field.at <= (100, 90))).all(axis=1)
    np.testing.assert_array_equal(field.matched, inside)


@pytest.mark.parametrize("order", ["best_first", "rows"])
def test_what_cannot_be_matched_stays_a_hole_and_growth_goes_around_it(order):
    hole = slice(40, 80), slice(60, 100)
    pair = images(hole)
    field = Growth(step_px=4, order=order, max_tries=4).grown(MATCHING, pair, seeds(pair, (32, 60)))
    places = field.at @ AFFINE.T + SHIFT
    in_hole = ((places >= (60, 40)) & (places < (100, 80))).all(axis=1)
    beyond = (places[:, 0] > 112) & (places[:, 0] < 148) & (places[:, 1] > 14) & (places[:, 1] < 104)
    assert field.matched[in_hole].mean() < 0.2
    assert field.matched[beyond].all()
    assert np.quantile(errors_of(field), 0.9) < 0.05


def test_a_larger_patch_measures_what_the_usual_one_cannot():
    texture = Waves(14, contrast=3.0)
    one, two = (deformed(texture, SIZE, np.eye(2), s, 1.0, k) for k, s in ((1, np.zeros(2)), (2, np.array([2.0, 1]))))
    pair = MATCHING.prepared(one), MATCHING.prepared(two)
    at = np.array([[60.0, 60]])
    start = MATCHING.with_patch(31).match(*pair, at, np.array([[62.0, 61]]))
    limits = {"step_px": 6, "max_sigma_px": 0.12, "min_correlation": 0.7}
    usual, larger = (
        Growth(retry_patch_px=patch, **limits).grown(MATCHING, pair, start).matched.sum() for patch in (None, 25)
    )
    assert larger > 2 * usual
    assert larger > 150


def test_limits_of_quality_are_kept():
    pair = images()
    growth = Growth(step_px=4, max_sigma_px=0.0075, min_correlation=0.99)
    field = growth.grown(MATCHING, pair, seeds(pair, (60, 60)))
    matches = field.matches
    assert 0.1 < field.matched.mean() < 0.9
    seed = field.cells_of(np.array([[60.0, 60]]))
    assert set(np.flatnonzero(field.matched & ~growth.good(matches))) <= set(seed)
    assert not Growth(max_stretch=1.01).good(matches).any()


@pytest.mark.parametrize("seed", range(20))
def test_the_stretch_is_the_largest_singular_value_or_its_inverse(seed):
    matrix = np.random.default_rng(seed).normal(size=(2, 2)) + np.eye(2)
    found = np.concatenate([[0, 0], matrix.ravel()])
    long, short = np.linalg.svd(matrix, compute_uv=False)
    expected = max(long, 1 / short) if np.linalg.det(matrix) > 0 else np.inf
    assert stretch(found) == pytest.approx(expected)


def test_the_neighbourhood_filter_finds_matches_that_do_not_fit_in():
    pair = images()
    field = Growth(step_px=4).grown(MATCHING, pair, seeds(pair, (60, 60)))
    columns = field.shape[1]
    away, turned, alone = 10 * columns + 15, 14 * columns + 20, 0
    found, ended = np.array(field.found), np.array(field.ended)
    found[away, 0] += 2.0
    found[turned, 3] += 0.3
    ended[alone], found[alone] = MATCHED, found[away]
    spoilt = replace(field, found=frozen(found), ended=frozen(ended, np.int64))
    doubtful = NeighbourhoodFilter().doubtful(spoilt)
    assert doubtful[[away, turned, alone]].all()
    assert doubtful.sum() <= 4
    mended = Growth(step_px=4).continued(MATCHING, pair, spoilt.without(doubtful))
    assert errors_of(mended).max() < 0.05
    assert mended.matched[[away, turned]].all()
    assert not mended.matched[alone]


def test_islands_are_removed():
    field = MatchField.empty(SIZE, 4)
    ended = np.array(field.ended).reshape(field.shape)
    ended[3:10, 3:10], ended[20:23, 20:23] = MATCHED, MATCHED
    found = np.array(field.found)
    found[:, :6] = np.c_[field.at, np.tile((1, 0, 0, 1), (len(found), 1))]
    field = replace(field, found=frozen(found), ended=frozen(ended.ravel(), np.int64))
    doubtful = NeighbourhoodFilter(min_island=30).doubtful(field).reshape(field.shape)
    assert not doubtful[3:10, 3:10].any()
    assert doubtful[20:23, 20:23].all()


def test_large_patches_are_corrected_for_the_curvature_of_the_shift():
    bend = 1.5e-3
    texture, places = Waves(7), pixels_of(SIZE)
    one = sensed(texture(places), 0.5, 1)
    # The inverse of x + bend (x - 80)^2 / 2, of which x's image is looked up
    x = 80 + (np.sqrt(1 + 2 * bend * (places[..., 0] - 80)) - 1) / bend
    two = sensed(texture(np.stack([x, places[..., 1]], axis=-1)), 0.5, 2)
    matching = MATCHING.with_patch(31)
    pair = matching.prepared(one), matching.prepared(two)
    at = np.array([[80.0, 60]])
    growth = Growth(step_px=4, retry_patch_px=None)
    field = growth.grown(matching, pair, matching.match(*pair, at, at))
    corrected = corrected_for_curvature(field)
    inner = field.matched & (np.abs(field.at[:, 0] - 80) < 30) & (np.abs(field.at[:, 1] - 60) < 20)
    true = field.at[inner, 0] + bend / 2 * (field.at[inner, 0] - 80) ** 2
    before, after = (np.mean(f.found[inner, 0] - true) for f in (field, corrected))
    assert inner.sum() > 50
    assert before == pytest.approx(0.5 * bend * 15 * 16 / 3, rel=0.2)
    assert abs(after) < 0.25 * before
    assert abs(np.mean(corrected_for_curvature(field, where_consistent=False).found[inner, 0] - true)) < 0.25 * before


def test_what_neighbours_do_not_agree_on_is_hardly_corrected():
    # A plane: the only slopes of the affine terms are noise
    rng = np.random.default_rng(0)
    field = MatchField.empty((200, 200), 4)
    found = np.array(field.found)
    found[:, :2], found[:, 2:6], found[:, HALF_PATCH] = field.at, (1, 0, 0, 1), 6
    found[:, 2:6] += 0.01 * rng.normal(size=(len(found), 4))
    field = MatchField(4, field.shape, found, np.zeros_like(field.ended))
    always, weighted = (
        np.sqrt(np.mean((corrected_for_curvature(field, how).found[:, :2] - field.at) ** 2)) for how in (False, True)
    )
    assert 0 < weighted < 0.6 * always


def test_voxels_hold_what_lies_in_them():
    points = np.random.default_rng(0).uniform(-1, 1, (500, 3))
    members = voxel_members(points, 0.25)
    cells = np.floor((points - points.min(axis=0)) / 0.25)
    same = (cells[:, None] == cells[None]).all(axis=2)
    np.testing.assert_array_equal(same, members[:, None] == members[None])
    assert set(members) == set(range(members.max() + 1))
