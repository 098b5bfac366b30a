"""Background subtraction: noise, shadows and objects of known places and strengths, regions of interest."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tracker.arrays import Image, Mask
from tracker.imaging.background import changed, difference, foreground, threshold_level

SIZE = 240, 320
BOX = slice(60, 180), slice(120, 180)
FLOOR = slice(130, 200), slice(200, 300)


def plate(texture: float = 25.0, seed: int = 0) -> Image:
    """A coloured wall with texture of a given strength, grey levels."""
    rng = np.random.default_rng(seed)
    grain = cv2.GaussianBlur(rng.standard_normal(SIZE).astype(np.float32), (0, 0), 1.5)
    grain *= texture / grain.std()
    image: Image = np.clip(np.array([110.0, 130.0, 150.0]) + grain[..., None], 20, 235).astype(np.uint8)
    return image


def seen(image: Image, noise: float, seed: int = 1) -> Image:
    """The picture of a camera with noise."""
    noisy = image + noise * np.random.default_rng(seed).standard_normal(image.shape)
    taken: Image = np.clip(np.round(noisy), 0, 255).astype(np.uint8)
    return taken


def covering(*places: tuple[slice, slice]) -> Mask:
    mask = np.zeros(SIZE, dtype=np.bool_)
    for place in places:
        mask[place] = True
    return mask


def with_object(image: Image, place: tuple[slice, slice] = BOX, colour: tuple[int, int, int] = (40, 60, 200)) -> Image:
    image = image.copy()
    image[place] = colour
    return image


def with_shadow(image: Image, share: float, place: tuple[slice, slice] = FLOOR) -> Image:
    image = image.copy()
    image[place] = np.round(image[place] * share)
    return image


def overlap(found: Mask, truth: Mask) -> float:
    return float((found & truth).sum() / (found | truth).sum())


@pytest.mark.parametrize("noise", [0.0, 2.0, 5.0])
def test_an_object_is_found_to_its_border(noise: float) -> None:
    found = foreground(seen(with_object(plate()), noise), seen(plate(), noise, seed=2))
    assert overlap(found, covering(BOX)) > 0.95
    far = cv2.dilate(covering(BOX).astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    assert not (found & ~far).any()


@pytest.mark.parametrize("noise", [0.0, 2.0, 5.0, 10.0])
def test_an_unchanged_background_has_no_foreground(noise: float) -> None:
    anything, mask = changed(seen(plate(), noise), seen(plate(), noise, seed=2))
    assert anything.mean() < 1e-3
    assert not mask.any()


@pytest.mark.parametrize("noise", [4.0, 8.0])
def test_the_threshold_is_so_many_deviations_of_the_noise(noise: float) -> None:
    # The largest of three channels' differences has the median sqrt(2) norm.ppf((1 + 0.5 ** (1 / 3)) / 2) = 1.785
    # noises, of a single channel it is 0.954. Grey levels are whole: the median may be off by half of one.
    one, other = seen(plate(), noise), seen(plate(), noise, seed=2)
    found = threshold_level(one, other, sigmas=6.0)
    assert abs(found - 6.0 * noise * 1.785 / 0.954) < 6.0 * 0.6 / 0.954
    disturbed = threshold_level(with_object(one), with_object(other, colour=(200, 60, 40)), sigmas=6.0)
    assert disturbed < 1.3 * found
    assert threshold_level(one, one, least=9.0) == 9.0


@pytest.mark.parametrize("share", [0.55, 0.7, 0.8])
@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_a_shadow_has_changed_but_is_no_foreground(share: float, noise: float) -> None:
    background = plate()
    image = with_shadow(with_object(background), share)
    anything, mask = changed(seen(image, noise), seen(background, noise, seed=2))
    inside = FLOOR[0].start + 6, FLOOR[0].stop - 6, FLOOR[1].start + 6, FLOOR[1].stop - 6
    core = np.s_[inside[0] : inside[1], inside[2] : inside[3]]
    assert anything[core].mean() > 0.6
    assert mask[core].mean() < 0.02
    assert overlap(mask & ~covering(FLOOR), covering(BOX)) > 0.95


def test_a_dark_object_of_the_backgrounds_colour_is_no_shadow() -> None:
    # It loses 35 % of the light like a shadow, but hides the texture.
    background = plate()
    colour = tuple(int(0.65 * c) for c in background.mean(axis=(0, 1)))
    mask = foreground(seen(with_object(background, colour=(colour[0], colour[1], colour[2])), 2.0), background)
    assert overlap(mask, covering(BOX)) > 0.85


def test_a_coloured_darkening_is_no_shadow() -> None:
    background = plate()
    image = background.copy()
    image[BOX] = np.round(image[BOX] * np.array([0.5, 0.7, 0.9]))
    assert overlap(foreground(image, background), covering(BOX)) > 0.9


def test_foreground_has_changed_up_to_closed_holes() -> None:
    image = seen(with_shadow(with_object(plate()), 0.6), 3.0)
    anything, mask = changed(image, seen(plate(), 3.0, seed=2))
    closed = cv2.morphologyEx(anything.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8)) > 0
    assert not (mask & ~closed).any()
    np.testing.assert_array_equal(mask, foreground(image, seen(plate(), 3.0, seed=2)))


def test_specks_far_smaller_than_the_largest_region_are_removed() -> None:
    image = with_object(with_object(plate()), (slice(20, 26), slice(20, 26)))
    anything, mask = changed(image, plate())
    assert anything[20:26, 20:26].all()
    assert not mask[20:26, 20:26].any()
    twins = with_object(with_object(plate()), (slice(60, 180), slice(20, 60)))
    assert overlap(foreground(twins, plate()), covering(BOX, (slice(60, 180), slice(20, 60)))) > 0.9


@pytest.mark.parametrize("region", [(100, 40, 100, 160), (90, 30, 230, 200)])
def test_a_region_of_interest_gives_what_the_whole_image_gives_inside(region: tuple[int, int, int, int]) -> None:
    image, background = seen(with_shadow(with_object(plate()), 0.7), 2.0), seen(plate(), 2.0, seed=2)
    whole, part = changed(image, background), changed(image, background, region)
    x, y, width, height = region
    # The filters reach 4 px over a border, the opening and closing 4 more.
    inner = np.s_[y + 8 : y + height - 8, x + 8 : x + width - 8]
    for everywhere, within in zip(whole, part, strict=True):
        np.testing.assert_array_equal(within[inner], everywhere[inner])
        outside = np.ones(SIZE, dtype=np.bool_)
        outside[y : y + height, x : x + width] = False
        assert within.shape == SIZE
        assert not within[outside].any()
    assert part[1].any()


def test_the_difference_is_that_of_the_channel_that_changes_most() -> None:
    background = np.full((30, 30, 3), 100, dtype=np.uint8)
    image = background.copy()
    image[..., 1] = 130
    image[..., 2] = 80
    np.testing.assert_array_equal(difference(image, background), np.full((30, 30), 30, dtype=np.uint8))
    np.testing.assert_array_equal(difference(background, image), difference(image, background))


def test_subtraction_is_deterministic_and_leaves_its_input_alone() -> None:
    image, background = seen(with_object(plate()), 3.0), plate()
    before = image.copy(), background.copy()
    first, second = changed(image, background), changed(image, background)
    for one, other in zip((*first, image, background), (*second, *before), strict=True):
        np.testing.assert_array_equal(one, other)
