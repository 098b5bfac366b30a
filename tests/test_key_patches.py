"""Key patches and the curvature of what they lie on, against plain twins."""

from __future__ import annotations

import numpy as np
from textures import Waves, deformed

from tracker.kernels.patches import LARGEST_PX, LEAST_NEIGHBOURS, NO_SHIFT_PX2, NO_SPREAD_PX2, bending_shifts
from tracker.points.following.keys import Keys, Quality, Starts, find_keys
from tracker.points.surfaces import LeastSquaresMatching

SIZE = (200, 160)


def test_keys_match_as_whole_images_do():
    affine, shift = np.array([[1.02, 0.03], [-0.02, 0.98]]), np.array([2.4, 1.7])
    one, two = (
        deformed(Waves(7), SIZE, *warp, 1.0, k) for k, warp in enumerate(((np.eye(2), (0, 0)), (affine, shift)))
    )
    matching = LeastSquaresMatching()
    template, search = matching.prepared(one), matching.prepared(two)
    at = np.random.default_rng(0).integers(20, 130, (40, 2)).astype(float)
    start = at @ affine.T + shift + 0.3
    whole = matching.match(template, search, at, start)
    keys = Keys.cut(template, at, matching.patch_px // 2)
    found = find_keys(
        matching,
        Quality(np.inf, np.inf, 0.0, np.inf),
        keys,
        np.arange(40),
        search,
        starts=Starts(start, np.tile(np.eye(2), (40, 1, 1))),
    )
    np.testing.assert_array_equal(found.good, whole.good)
    # single precision sums, whose order is the compiler's
    np.testing.assert_allclose(found.pixels[found.good], whole.pixels[whole.good], atol=1e-5)
    np.testing.assert_allclose(found.affine[found.good], whole.affine[whole.good], atol=1e-5)
    between = Keys.cut(template, at + 0.3, matching.patch_px // 2)
    moved = find_keys(
        matching,
        Quality(np.inf, np.inf, 0.0, np.inf),
        between,
        np.arange(40),
        search,
        starts=Starts(start + 0.3, np.tile(np.eye(2), (40, 1, 1))),
    )
    gaps = moved.pixels[moved.good] - ((at + 0.3) @ affine.T + shift)[moved.good]
    assert np.sqrt(np.mean(gaps**2)) < 0.03
    border = Keys.cut(template, np.array([[3.0, 80.0], [np.nan, 80.0], [60.0, 80.0]]), 6)
    np.testing.assert_array_equal(border.usable, [False, False, True])


def plain_bending(offsets, rows, affine, known, half):
    """Twin of `bending_shifts` in arrays."""
    near = np.maximum(rows, 0)
    weight = ((rows >= 0) & known[near]).astype(float)
    count = weight.sum(axis=1) + 1
    o, terms = offsets * weight[..., None], affine.reshape(-1, 4)
    difference = (terms[near] - terms[:, None]) * weight[..., None]
    mean_o, mean_d = o.sum(axis=1) / count[:, None], difference.sum(axis=1) / count[:, None]
    spread = np.einsum("nki,nkj->nij", o, o) - count[:, None, None] * mean_o[:, :, None] * mean_o[:, None]
    mixed = np.einsum("nki,nkj->nij", o, difference) - count[:, None, None] * mean_o[:, :, None] * mean_d[:, None]
    slopes = np.linalg.solve(spread + NO_SPREAD_PX2 * np.eye(2), mixed)
    shift = half * (half + 1) / 6 * np.stack([slopes[:, 0, 0] + slopes[:, 1, 1], slopes[:, 0, 2] + slopes[:, 1, 3]], 1)
    usable = known & (count > LEAST_NEIGHBOURS) & (np.abs(shift).max(axis=1) <= LARGEST_PX)
    shift[~usable] = 0
    weight *= usable[near]
    mean = (shift + np.einsum("nki,nk->ni", shift[near], weight)) / (weight.sum(axis=1) + 1)[:, None]
    square = (shift**2).sum(axis=1) + np.einsum("nki,nki,nk->n", shift[near], shift[near], weight)
    consistency = (mean**2).sum(axis=1) * (weight.sum(axis=1) + 1) / np.maximum(square, NO_SHIFT_PX2)
    return shift * consistency[:, None]


def test_bending_is_its_plain_twin_and_that_of_a_parabola():
    rng = np.random.default_rng(0)
    rows, known = rng.integers(-1, 300, (300, 12)), rng.random(300) > 0.3
    offsets, affine = 8 * rng.normal(size=(300, 12, 2)), np.eye(2) + 0.01 * rng.normal(size=(300, 2, 2))
    found = bending_shifts(offsets, rows, affine, known, 6)
    np.testing.assert_allclose(found, plain_bending(offsets, rows, affine, known, 6), atol=1e-12)
    places = rng.uniform(0, 40, (300, 2))
    near = np.argsort(np.linalg.norm(places[:, None] - places, axis=2), axis=1)[:, 1:13]
    # s = (x + a x^2 / 2, y): its affine matrix is (1 + a x, 0, 0, 1), and the mean over the patch m a / 2 beside it
    bent = np.tile(np.eye(2), (300, 1, 1))
    bent[:, 0, 0] += 1e-3 * places[:, 0]
    shifts = bending_shifts(places[near] - places[:, None], near, bent, np.ones(300, dtype=bool), 6)
    np.testing.assert_allclose(shifts[:, 0], 0.5 * 1e-3 * 14, rtol=0.1)
    np.testing.assert_allclose(shifts[:, 1], 0, atol=1e-12)
