"""Background subtraction: noise, shadows and objects of known places and strengths, regions of interest."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tracker.foundation.arrays import Array, Image, Mask, frozen
from tracker.images.plate import _SHADOW, Plate, changed, difference, foreground, threshold_level
from tracker.kernels.changes import MARGIN, large_regions, mark_changes, median_level, without_shadows

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
    found = foreground(seen(with_object(plate()), noise), Plate(seen(plate(), noise, seed=2)))
    assert overlap(found, covering(BOX)) > 0.95
    far = cv2.dilate(covering(BOX).astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    assert not (found & ~far).any()


@pytest.mark.parametrize("noise", [0.0, 2.0, 5.0, 10.0])
def test_an_unchanged_background_has_no_foreground(noise: float) -> None:
    anything, mask, _ = changed(seen(plate(), noise), Plate(seen(plate(), noise, seed=2)))
    assert anything.mean() < 1e-3
    assert not mask.any()


@pytest.mark.parametrize("noise", [4.0, 8.0])
def test_the_threshold_is_so_many_deviations_of_the_noise(noise: float) -> None:
    # The largest of three channels' differences has the median sqrt(2) norm.ppf((1 + 0.5 ** (1 / 3)) / 2) = 1.785
    # noises, of a single channel it is 0.954. Grey levels are whole: the median may be off by half of one.
    one, other = seen(plate(), noise), seen(plate(), noise, seed=2)
    found = threshold_level(one, Plate(other), sigmas=6.0)
    assert abs(found - 6.0 * noise * 1.785 / 0.954) < 6.0 * 0.6 / 0.954
    disturbed = threshold_level(with_object(one), Plate(with_object(other, colour=(200, 60, 40))), sigmas=6.0)
    assert disturbed < 1.3 * found
    assert threshold_level(one, Plate(one), least=9.0) == 9.0


@pytest.mark.parametrize("share", [0.55, 0.7, 0.8])
@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_a_shadow_has_changed_but_is_no_foreground(share: float, noise: float) -> None:
    background = plate()
    image = with_shadow(with_object(background), share)
    anything, mask, _ = changed(seen(image, noise), Plate(seen(background, noise, seed=2)))
    inside = FLOOR[0].start + 6, FLOOR[0].stop - 6, FLOOR[1].start + 6, FLOOR[1].stop - 6
    core = np.s_[inside[0] : inside[1], inside[2] : inside[3]]
    assert anything[core].mean() > 0.6
    assert mask[core].mean() < 0.02
    assert overlap(mask & ~covering(FLOOR), covering(BOX)) > 0.95


def test_a_dark_object_of_the_backgrounds_colour_is_no_shadow() -> None:
    # It loses 35 % of the light like a shadow, but hides the texture.
    background = plate()
    colour = tuple(int(0.65 * c) for c in background.mean(axis=(0, 1)))
    mask = foreground(seen(with_object(background, colour=(colour[0], colour[1], colour[2])), 2.0), Plate(background))
    assert overlap(mask, covering(BOX)) > 0.85


def test_a_coloured_darkening_is_no_shadow() -> None:
    background = plate()
    image = background.copy()
    image[BOX] = np.round(image[BOX] * np.array([0.5, 0.7, 0.9]))
    assert overlap(foreground(image, Plate(background)), covering(BOX)) > 0.9


def with_soft_shadow(image: Image | Array, share: float, width: float, place: tuple[slice, slice] = FLOOR) -> Image:
    """A shadow whose border is as wide as a Gaussian of so many px."""
    dark = cv2.GaussianBlur(covering(place).astype(np.float32), (0, 0), width)
    darkened: Image = np.round(image * (1 - (1 - share) * dark[..., None])).astype(np.uint8)
    return darkened


@pytest.mark.parametrize("share", [0.5, 0.6, 0.7])
@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_a_soft_shadow_on_a_smooth_floor_is_no_foreground(share: float, noise: float) -> None:
    smooth = plate(texture=1.0)
    image = with_soft_shadow(with_object(smooth), share, 5.0)
    anything, mask, _ = changed(seen(image, noise), Plate(seen(smooth, noise, seed=2)))
    assert anything[150:180, 220:280].all()
    assert overlap(mask, covering(BOX)) > 0.95


@pytest.mark.parametrize("share", [0.5, 0.6, 0.7])
@pytest.mark.parametrize("noise", [0.0, 2.0])
@pytest.mark.parametrize("blur_px", [0.5, 1.0])
def test_an_object_like_a_shadow_on_a_smooth_floor_is_told_by_its_sharp_outline(
    share: float, noise: float, blur_px: float
) -> None:
    smooth = plate(texture=1.0)
    inside = cv2.GaussianBlur(covering(BOX).astype(np.float32), (0, 0), blur_px)[..., None]
    mixed = smooth * (1 - inside) + share * smooth.mean(axis=(0, 1)) * inside
    image = with_soft_shadow(mixed, share, 5.0)
    mask = foreground(seen(image, noise), Plate(seen(smooth, noise, seed=2)))
    assert overlap(mask, covering(BOX)) > 0.9


def test_the_shadow_of_an_object_that_looks_like_it_goes_and_the_object_stays() -> None:
    # Trousers of the floor's colour in the lower half of the box, which the shadow begins at.
    smooth = plate(texture=1.0)
    image = with_soft_shadow(smooth, 0.65, 5.0, (slice(170, 185), slice(100, 300)))
    image[BOX] = (40, 60, 200)
    image[120:180, 120:180] = np.round(0.5 * smooth.mean(axis=(0, 1)))
    mask = foreground(seen(image, 1.0), Plate(seen(smooth, 1.0, seed=2)))
    assert mask[BOX].mean() > 0.85  # a notch at the foot, where the shadow's outline is nearer than the trousers'
    assert (mask & ~covering(BOX)).sum() < 0.03 * covering(BOX).sum()


CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))


def grown(mask: Mask, kernel: Image) -> Mask:
    larger: Mask = cv2.dilate(mask.astype(np.uint8), kernel) > 0
    return larger


def steps(region: Mask, start: Mask) -> Array:
    """Steps (h, w) along the region from the nearest starting pixel."""
    reached, taken = start, np.where(start, 0.0, np.inf)
    for step in range(1, int(region.sum())):
        further = grown(reached, CROSS) & region & ~reached
        if not further.any():
            break
        taken[further] = step
        reached = reached | further
    return taken


def plain_objects(image: Image, background: Image, moving: Mask) -> tuple[Mask, Mask]:
    """The twin of the subtraction of shadows: whole images, not the pixels that have changed; and what is a tie."""
    least, least_smooth, most, chroma, texture, outline_px = _SHADOW
    now, before = (cv2.GaussianBlur(picture, (5, 5), 0).astype(float) for picture in (image, background))
    ratio = (now * before).sum(axis=2) / np.maximum((before * before).sum(axis=2), 1)
    off = np.abs(now - ratio[..., None] * before).max(axis=2)

    def mean(values: Array) -> Array:
        filtered: Array = cv2.boxFilter(values, cv2.CV_64F, (9, 9))
        return filtered

    a, b = now.mean(axis=2), before.mean(axis=2)
    variances = (np.maximum(mean(c * c) - mean(c) ** 2, 1) for c in (a, b))
    textured = mean(a * b) - mean(a) * mean(b) > texture * np.sqrt(np.prod(list(variances), axis=0))
    like: Mask = moving & (least < ratio) & (ratio < most) & (off < chroma)
    undecided = like & (ratio <= least_smooth) & ~textured
    wide = np.pad(ratio, 2, mode="reflect")
    slope = np.hypot(wide[2:-2, 4:] - wide[2:-2, :-4], wide[4:, 2:-2] - wide[:-4, 2:-2]) / 4
    objects, ties = moving & ~like, np.zeros(moving.shape, dtype=np.bool_)
    beside = grown(objects, np.ones((3, 3), np.uint8))
    n, labels = cv2.connectedComponents(undecided.astype(np.uint8), connectivity=4)
    for k in range(1, n):
        region: Mask = labels == k
        outline = region & grown(np.pad(~region, 1, constant_values=True), CROSS)[1:-1, 1:-1]
        sharp = outline & (beside | (slope > (1 - ratio[region].mean()) / outline_px))
        share = sharp.sum() / outline.sum()
        if share >= 0.5:
            objects = objects | region
        elif share >= 0.2:
            to_sharp, to_soft = steps(region, sharp), steps(region, outline & ~sharp)
            objects = objects | (region & (to_sharp < to_soft))
            ties = ties | (region & (to_sharp == to_soft))
    return objects, ties


@pytest.mark.parametrize("texture", [0.5, 4.0, 25.0])
@pytest.mark.parametrize("region", [(0, 0, 320, 240), (90, 30, 230, 200)])
def test_shadows_are_subtracted_as_by_the_plain_twin(texture: float, region: tuple[int, int, int, int]) -> None:
    background = plate(texture)
    shaded = with_soft_shadow(with_shadow(background, 0.6), 0.6, 5.0, (slice(150, 238), slice(20, 160)))
    image = seen(with_object(with_object(shaded), (slice(40, 110), slice(60, 100)), (66, 78, 90)), 1.5)
    moving = difference(image, Plate(background)) > threshold_level(image, Plate(background))
    x, y, width, height = region
    part = np.s_[y : y + height, x : x + width]
    found = np.empty((height, width), dtype=np.uint8)
    smooth, before = (
        cv2.GaussianBlur(np.pad(one, ((MARGIN, MARGIN), (MARGIN, MARGIN), (0, 0)), mode="reflect"), (5, 5), 0)
        for one in (image, background)
    )
    near = np.ascontiguousarray(smooth[y : y + height + 2 * MARGIN, x : x + width + 2 * MARGIN])
    without_shadows(near, before, (x, y), np.array(moving[part]).view(np.uint8), _SHADOW, found)
    inside = np.zeros(SIZE, dtype=np.bool_)
    inside[part] = moving[part]
    # Thresholds are compared in other precisions.
    objects, ties = plain_objects(image, background, inside)
    assert ((found > 0) != objects[part])[~ties[part]].mean() < 1e-4
    assert 0.05 < found.mean() < 0.5


@pytest.mark.parametrize("level", [14.0, 30.7, 255.0, 400.0])
def test_changes_are_marked_as_by_numpy(level: float) -> None:
    image, background = np.random.default_rng(4).integers(0, 256, (2, 40, 53, 3), dtype=np.uint8)
    background[:20] = np.clip(image[:20].astype(int) + np.random.default_rng(5).integers(-40, 41, (20, 53, 3)), 0, 255)
    moving = np.full((20, 30), 7, dtype=np.uint8)
    mark_changes(np.array(image[9:31, 6:38]), background, (7, 10), level, moving)
    apart = np.abs(image.astype(int) - background).max(axis=2)
    np.testing.assert_array_equal(moving, (apart > level)[10:30, 7:37])


@pytest.mark.parametrize("size", [(1, 1), (2, 3), (60, 81)])
def test_the_median_level_is_that_of_numpy(size: tuple[int, int]) -> None:
    picture = np.random.default_rng(4).integers(0, 256, size, dtype=np.uint8)
    assert median_level(picture) == np.median(picture)
    assert median_level(np.full(size, 255, dtype=np.uint8)) == 255
    assert median_level(np.zeros_like(picture)) == 0


def test_large_regions_equal_their_numpy_twin() -> None:
    noise = (np.random.default_rng(8).random((60, 80)) < 0.45).astype(np.uint8)
    for picture in (noise, np.zeros_like(noise)):
        n, labels = cv2.connectedComponents(picture)
        areas = np.bincount(labels.ravel(), minlength=n)
        areas[0] = 0
        found = np.empty(labels.shape, dtype=np.bool_)
        large_regions(labels, n, 0.1, found)
        np.testing.assert_array_equal(found, ((areas > 0) & (areas >= 0.1 * areas.max()))[labels])


def test_a_plate_keeps_what_it_was_made_of_and_makes_the_rest_once() -> None:
    writable = plate()
    kept = Plate(writable)
    before = changed(seen(with_object(writable), 2.0), kept)
    writable[:] = 0
    for one, other in zip(before, changed(seen(with_object(plate()), 2.0), Plate(plate())), strict=True):
        np.testing.assert_array_equal(one, other)
    assert kept.coarse is kept.coarse
    assert not kept.picture.flags.writeable
    lasting = frozen(plate(), np.uint8)
    assert Plate(lasting).picture is lasting


def test_foreground_has_changed_up_to_closed_holes() -> None:
    image = seen(with_shadow(with_object(plate()), 0.6), 3.0)
    anything, mask, _ = changed(image, Plate(seen(plate(), 3.0, seed=2)))
    closed = cv2.morphologyEx(anything.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8)) > 0
    assert not (mask & ~closed).any()
    np.testing.assert_array_equal(mask, foreground(image, Plate(seen(plate(), 3.0, seed=2))))


def test_specks_far_smaller_than_the_largest_region_are_removed() -> None:
    image = with_object(with_object(plate()), (slice(20, 26), slice(20, 26)))
    anything, mask, _ = changed(image, Plate(plate()))
    assert anything[20:26, 20:26].all()
    assert not mask[20:26, 20:26].any()
    twins = with_object(with_object(plate()), (slice(60, 180), slice(20, 60)))
    assert overlap(foreground(twins, Plate(plate())), covering(BOX, (slice(60, 180), slice(20, 60)))) > 0.9


@pytest.mark.parametrize("region", [(100, 40, 100, 160), (90, 30, 230, 200)])
def test_a_region_of_interest_gives_what_the_whole_image_gives_inside(region: tuple[int, int, int, int]) -> None:
    image, background = seen(with_shadow(with_object(plate()), 0.7), 2.0), seen(plate(), 2.0, seed=2)
    whole, part = changed(image, Plate(background)), changed(image, Plate(background), region)
    x, y, width, height = region
    # The filters reach 4 px over a border, the opening and closing 4 more.
    inner = np.s_[y + 8 : y + height - 8, x + 8 : x + width - 8]
    for everywhere, within in zip(whole[:2], part[:2], strict=True):
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
    np.testing.assert_array_equal(difference(image, Plate(background)), np.full((30, 30), 30, dtype=np.uint8))
    np.testing.assert_array_equal(difference(background, Plate(image)), difference(image, Plate(background)))


def test_subtraction_is_deterministic_and_leaves_its_input_alone() -> None:
    image, background = seen(with_object(plate()), 3.0), plate()
    before = image.copy(), background.copy()
    first, second = changed(image, Plate(background)), changed(image, Plate(background))
    for one, other in zip((*first, image, background), (*second, *before), strict=True):
        np.testing.assert_array_equal(one, other)
