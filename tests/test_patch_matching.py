"""Least squares matching: interpolation and equations against plain twins, exact deformations, honest sigmas."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d, map_coordinates, spline_filter
from scipy.optimize import least_squares
from textures import Waves, deformed

from tracker._native import reaches_out
from tracker.foundation.errors import ConfigError
from tracker.kernels.patches import (
    COVARIANCE,
    DRIFTED,
    HALF_PATCH,
    MATCHED,
    N_FOUND,
    NOT_CONVERGED,
    OUTSIDE,
    WEAK,
    grow,
    sample_gradient,
    sample_patch,
    sample_whole_pixels,
)
from tracker.points.surfaces import LeastSquaresMatching, gaussian_taps, noise_powers

SIZE = (180, 140)
AFFINE = np.array([[1.02, 0.03], [-0.02, 0.98]])
SHIFT = np.array([2.4, 1.7])
FORMS = ("inverse_compositional", "classical")


def pair(noise=0.0, contrast=40.0, wavelength=7.0, affine=AFFINE, shift=SHIFT):
    texture = Waves(wavelength, contrast)
    return (
        deformed(texture, SIZE, np.eye(2), np.zeros(2), noise, 1),
        deformed(texture, SIZE, affine, shift, noise, 2),
    )


def grid(step=9, margin=22):
    axes = np.arange(margin, SIZE[0] - margin, step), np.arange(margin, SIZE[1] - margin, step)
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2).astype(float)


def matched(matching, images, at, start, affine=None):
    return matching.match(*(matching.prepared(image) for image in images), at, start, affine)


def started(at, affine=AFFINE, shift=SHIFT, off=0.4):
    return at @ affine.T + shift + np.random.default_rng(0).uniform(-off, off, at.shape)


@pytest.mark.parametrize("sigma", [0.0, 0.8])
def test_prepared_images_are_the_recursive_filters_spline_coefficients(sigma):
    image = np.random.default_rng(0).integers(0, 256, (60, 90)).astype(np.uint8)
    smooth = image.astype(float)
    for axis in range(2 if sigma else 0):
        smooth = gaussian_filter1d(smooth, sigma, axis, mode="mirror", radius=round(4 * sigma))
    expected = spline_filter(smooth, order=3, output=np.float64, mode="mirror")
    found = LeastSquaresMatching(smoothing_px=sigma).prepared(image)
    # single precision of values of up to a few hundred
    np.testing.assert_allclose(found.coefficients.reshape(60, 90), expected, atol=1e-3)


WARP = np.array([61.3, 70.8, 1.05, 0.04, -0.06, 0.93])


def plain_samples(image, warp, half, dx=0.0, dy=0.0):
    i, j = np.meshgrid(np.arange(-half, half + 1), np.arange(-half, half + 1))
    rows = warp[1] + dy + warp[4] * i + warp[5] * j
    columns = warp[0] + dx + warp[2] * i + warp[3] * j
    return map_coordinates(np.asarray(image, float), [rows, columns], order=3, mode="mirror").ravel()


@pytest.mark.parametrize("half", [2, 6, 15])
def test_samples_and_slopes_equal_their_plain_twins(half):
    image = pair(noise=5.0)[0]
    packed = LeastSquaresMatching(smoothing_px=0).prepared(image).packed
    n, eps = (2 * half + 1) ** 2, 1e-4
    grey, dx, dy, alone = np.zeros((4, n), np.float32)
    sample_gradient(packed, WARP, half, grey, dx, dy)
    sample_patch(packed, WARP, half, alone)
    np.testing.assert_allclose(grey, plain_samples(image, WARP, half), atol=0.01)
    np.testing.assert_allclose(alone, grey, atol=1e-3)
    along = plain_samples(image, WARP, half, eps) - plain_samples(image, WARP, half, -eps)
    down = plain_samples(image, WARP, half, 0, eps) - plain_samples(image, WARP, half, 0, -eps)
    np.testing.assert_allclose(dx, along / (2 * eps), atol=0.02)
    np.testing.assert_allclose(dy, down / (2 * eps), atol=0.02)


def test_whole_pixels_are_sampled_as_any_others():
    packed = LeastSquaresMatching().prepared(pair(noise=5.0)[0]).packed
    general, quick = np.zeros((2, 3, 169), np.float32)
    sample_gradient(packed, np.array([50.0, 60.0, 1, 0, 0, 1]), 6, *general)
    sample_whole_pixels(packed, 50, 60, 6, *quick)
    np.testing.assert_allclose(quick, general, atol=2e-3)


def test_patches_that_touch_the_border_are_known():
    assert not reaches_out(np.array([8.0, 8.0, 1, 0, 0, 1]), 6, 180, 140)
    for x, y in ((7.9, 70.0), (70.0, 7.9), (171.1, 70.0), (70.0, 131.1), (np.nan, 70.0)):
        assert reaches_out(np.array([x, y, 1, 0, 0, 1]), 6, 180, 140)
    assert reaches_out(np.array([70.0, 70.0, 40, 0, 0, 1]), 6, 180, 140)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("patch", [13, 21])
@pytest.mark.parametrize("whole", [True, False])
def test_an_exact_deformation_is_found(form, patch, whole):
    matching = LeastSquaresMatching(form=form, patch_px=patch, smoothing_px=0.0, tolerance_px=0.002)
    at = grid() + (0.0 if whole else 0.37)
    matches = matched(matching, pair(), at, started(at))
    assert matches.good.all()
    # Rounding to whole grey levels is a noise of 0.29.
    assert np.abs(matches.pixels - (at @ AFFINE.T + SHIFT)).max() < 0.02
    np.testing.assert_allclose(matches.affine, np.tile(AFFINE, (len(at), 1, 1)), atol=0.01)
    np.testing.assert_allclose(matches.found[:, 6], 0, atol=3)
    np.testing.assert_allclose(matches.found[:, 7], 1, atol=0.02)
    assert (matches.correlation > 0.999).all()


@pytest.mark.parametrize("form", FORMS)
def test_brightness_and_contrast_are_found(form):
    one, two = pair()
    dimmed = np.round(0.6 * two.astype(float) + 20).astype(np.uint8)
    at = grid()
    matches = matched(LeastSquaresMatching(form=form), (one, dimmed), at, started(at))
    assert matches.good.all()
    np.testing.assert_allclose(matches.found[:, 7], 1 / 0.6, rtol=0.03)
    np.testing.assert_allclose(matches.found[:, 6], -20 / 0.6, atol=4)


def test_the_classical_form_minimizes_what_a_plain_solver_minimizes():
    matching = LeastSquaresMatching(form="classical", smoothing_px=0.0, tolerance_px=1e-4)
    images, at = pair(noise=2.0), grid(40)
    matches = matched(matching, images, at, started(at))
    for k, place in enumerate(at):
        template = plain_samples(images[0], np.array([*place, 1, 0, 0, 1]), 6)

        def residual(p, template=template):
            return p[6] + p[7] * plain_samples(images[1], p, 6) - template

        best = least_squares(residual, matches.found[k, :8], x_scale=[1, 1, 0.1, 0.1, 0.1, 0.1, 10, 0.1])
        np.testing.assert_allclose(matches.pixels[k], best.x[:2], atol=2e-3)
        assert matches.sigma0[k] == pytest.approx(np.sqrt(2 * best.cost / (169 - 8)), rel=0.01)


def test_both_forms_agree_within_their_noise():
    images, at = pair(noise=1.0), grid()
    one, other = (matched(LeastSquaresMatching(form=form), images, at, started(at)) for form in FORMS)
    assert np.abs(one.pixels - other.pixels).max() < 0.02
    np.testing.assert_allclose(one.sigmas, other.sigmas, rtol=0.1)
    np.testing.assert_allclose(one.covariances, np.swapaxes(one.covariances, 1, 2))


def test_a_match_that_fails_says_how():
    images, at = pair(), np.array([[90.0, 70.0]])
    start = at @ AFFINE.T + SHIFT

    def ended(images, at, start, **fields):
        return matched(LeastSquaresMatching(**fields), images, np.asarray(at), np.asarray(start)).ended.tolist()

    assert ended(images, at, start) == [MATCHED]
    assert ended(images, [[5.0, 70.0]], start) == [OUTSIDE]
    assert ended(images, at, [[178.0, 70.0]]) == [OUTSIDE]
    assert ended(images, at, [[np.nan, 70.0]]) == [OUTSIDE]
    assert ended(images, at, start + 1.0, max_shift_px=0.5) == [DRIFTED]
    assert ended(images, at, start + 1.0, max_iterations=2, tolerance_px=1e-6) == [NOT_CONVERGED]
    assert ended((np.full_like(images[0], 90), images[1]), at, start) == [WEAK]
    assert ended((images[0], np.full_like(images[1], 90)), at, start) == [WEAK]
    assert ended((images[0], 255 - images[0]), at, at) != [MATCHED]
    stripes = np.tile((128 + 60 * np.sin(np.arange(SIZE[0]))).astype(np.uint8), (SIZE[1], 1))
    assert ended((stripes, stripes), at, at, smoothing_px=0.0) == [WEAK]


@pytest.mark.parametrize("smoothing", [0.0, 0.8])
def test_noise_powers_equal_those_of_simulated_noise(smoothing):
    powers = noise_powers(smoothing)
    noise = 40 * np.random.default_rng(0).normal(size=(2, 300, 300))
    matching = LeastSquaresMatching(smoothing_px=smoothing)
    one, two = (matching.prepared(image.astype(np.float32)).packed for image in noise)
    rng, half = np.random.default_rng(1), 12
    n, residuals, slopes = (2 * half + 1) ** 2, [], []
    fixed, dx, dy, moved = np.zeros((4, n), np.float32)
    for _ in range(60):
        column, row = rng.integers(30, 270, 2)
        sample_whole_pixels(one, column, row, half, fixed, dx, dy)
        # A slight turn, so that a patch has all fractions of a pixel.
        sample_patch(two, np.array([*rng.uniform(40, 260, 2), 0.99, 0.1, -0.1, 0.99]), half, moved)
        residuals.append(fixed - moved)
        slopes.append(np.stack([dx, dy]))
    assert np.var(residuals) / 40**2 == pytest.approx(powers.residual, rel=0.05)
    assert np.var(slopes) / 40**2 == pytest.approx(powers.gradient_of_template, rel=0.05)
    assert gaussian_taps(smoothing).sum() == pytest.approx(1)


@pytest.mark.parametrize(("contrast", "wavelength", "prior"), [(40.0, 7.0, None), (4.0, 14.0, None), (4.0, 14.0, 0.01)])
@pytest.mark.parametrize("patch", [13, 21])
def test_sigmas_are_honest_on_strong_and_on_weak_texture(contrast, wavelength, prior, patch):
    images = pair(1.0, contrast, wavelength, np.eye(2), np.array([0.4, 0.7]))
    at = grid(3)
    matching = LeastSquaresMatching(patch_px=patch, prior_sd=prior)
    matches = matched(matching, images, at, started(at, np.eye(2), np.array([0.4, 0.7]), 0.3))
    usable = matches.good & (matches.sigmas < 0.5).all(axis=1)
    assert usable.mean() > 0.9
    ratio = (matches.pixels - at - (0.4, 0.7))[usable] / matches.sigmas[usable]
    assert 0.8 < np.sqrt(np.mean(ratio**2)) < 1.3
    if contrast == 40:
        assert matches.sigmas[usable].max() < 0.03


def test_a_larger_patch_is_as_precise_after_a_small_one_as_alone():
    small, larger = LeastSquaresMatching(), LeastSquaresMatching(patch_px=21)
    images, at = pair(2.0), np.array([[90.0, 70.0]])
    sigmas = [matched(matching, images, at, started(at)).sigmas.max() for matching in (small, larger)]
    packed, columns, rows, pixels = tuple(small.prepared(image).packed for image in images), 18, 14, 10
    source, right = 7 * columns + 8, 0

    def covariance(usual):
        found, (ended, seeds) = np.zeros((columns * rows, N_FOUND)), np.full((2, columns * rows), -1)
        found[source, :6], ended[source] = (*(AFFINE @ (80.0, 70.0) + SHIFT), *AFFINE.ravel()), MATCHED
        heap = np.zeros(1), np.array([4 * source + right]), np.array([1])
        judging, state = (larger.noise, (np.inf, np.sqrt(np.prod(sigmas)), 0.0, 2.0)), (found, ended, seeds, 0 * ended)
        grow(packed, (columns, rows, pixels), state, heap, (usual.rule, larger.rule), judging, (1, 1))
        assert ended[source + 1] == MATCHED
        assert found[source + 1, HALF_PATCH] == 10
        return found[source + 1, COVARIANCE]

    np.testing.assert_allclose(covariance(small), covariance(larger), rtol=1e-6)


def test_smoothing_keeps_the_bias_of_interpolation_below_two_thousandths():
    at = grid(4)
    for fraction in (0.25, 0.5, 0.75):
        shift = np.array([fraction, 1 - fraction])
        images = pair(1.0, wavelength=9.0, affine=np.eye(2), shift=shift)
        matches = matched(LeastSquaresMatching(), images, at, started(at, np.eye(2), shift, 0.2))
        assert matches.good.all()
        assert np.abs((matches.pixels - at - shift).mean(axis=0)).max() < 0.002


def test_a_strong_prior_holds_the_affine_terms_at_their_start():
    images, at = pair(noise=2.0), grid(20)
    affine = np.tile(AFFINE, (len(at), 1, 1))
    free, held = (matched(LeastSquaresMatching(prior_sd=sd), images, at, started(at), affine) for sd in (None, 1e-4))
    assert np.abs(held.affine - AFFINE).max() < 1e-3 < np.abs(free.affine - AFFINE).max()
    assert np.abs(held.pixels - (at @ AFFINE.T + SHIFT)).max() < 0.06


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="odd number"):
        LeastSquaresMatching(patch_px=12)
    matching = LeastSquaresMatching()
    image = matching.prepared(pair()[0])
    with pytest.raises(ConfigError, match=r"\(N, 2\) expected"):
        matching.match(image, image, grid(), grid()[:3])
