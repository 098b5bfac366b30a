"""What pixels look like to region evidence: lightness, chroma, texture."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from observations import bent, four_views
from painted import painted

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Person, Scene
from tracker.cameras.frame import Frame
from tracker.evidence.measures.account import Account
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.regions import RegionEvidence
from tracker.foundation.arrays import Array, Image, Region
from tracker.images.operations.appearance import appearance, is_monochrome
from tracker.images.sight import Sight
from tracker.kernels.changes import count_coloured, mark_appearance
from tracker.synthesis.cpu import CpuSynthesis

RNG = np.random.default_rng(3)
BIN = 16


def grey_of(levels: Array) -> Image:
    return np.repeat(np.clip(np.round(levels), 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def plain(*bgr: int) -> Image:
    return np.full((40, 24, 3), bgr, dtype=np.uint8)


def coloured(image: Image) -> Image:
    """The same with some rows at the bottom in colours, so that it is of a colour camera."""
    shown = image.copy()
    shown[-16:] = 40, 70, 140
    return shown


@pytest.mark.parametrize("in_colours", [False, True])
@pytest.mark.parametrize("region", [(0, 0, 120, 90), (31, 17, 40, 50), (0, 40, 9, 50), (100, 0, 20, 3), (60, 88, 1, 2)])
def test_a_region_is_that_of_the_whole_picture(region: Region, in_colours: bool) -> None:
    noise = np.random.default_rng(7).integers(0, 256, (90, 120, 3)).astype(np.uint8)
    noise = noise if in_colours else grey_of(noise[..., 0])
    x, y, width, height = region
    whole = appearance(noise, (0, 0, 120, 90))
    np.testing.assert_array_equal(appearance(noise, region), whole[y : y + height, x : x + width])


def looked_up(image: Image, chroma: Image, slopes: tuple[int, int, int], grey: bool) -> Image:
    """What each pixel of an image looks like, a picture for each step of it."""
    lightness, red, blue = cv2.split(cv2.cvtColor(image, cv2.COLOR_BGR2YCrCb))
    across, along = (
        cv2.blur(cv2.convertScaleAbs(slope, alpha=10 / 8), (7, 7)) for slope in cv2.spatialGradient(lightness)
    )
    if grey:
        return np.stack([lightness, across, along], axis=-1)
    forth_and_back = 16 * np.array([[0, 1, 2, 3], [7, 6, 5, 4], [8, 9, 10, 11], [15, 14, 13, 12]], dtype=np.uint8)
    classes = forth_and_back[np.searchsorted(slopes, across), np.searchsorted(slopes, along)]
    return np.stack([lightness, chroma[7 * red.astype(int) - 4 * blue.astype(int) + 1020], classes], axis=-1)


@pytest.mark.parametrize("grey", [False, True])
@pytest.mark.parametrize("size", [(90, 120), (9, 5), (3, 40), (40, 2), (4, 4)])
def test_one_pass_looks_up_what_a_pass_for_each_step_does(size: tuple[int, int], grey: bool) -> None:
    rng = np.random.default_rng(5)
    image = cv2.GaussianBlur(rng.integers(0, 256, (*size, 3), np.uint8), (0, 0), 0.8)
    chroma, slopes = rng.integers(0, 256, 2806, np.uint8), (60, 90, 130)
    whole = looked_up(image, chroma, slopes, grey)
    for _ in range(20):
        left, top = (int(rng.integers(0, length)) for length in size[::-1])
        looks = np.zeros(
            (int(rng.integers(1, size[0] - top + 1)), int(rng.integers(1, size[1] - left + 1)), 3), np.uint8
        )
        mark_appearance(image, (left, top), (7, -4, 1020), chroma, slopes, grey, looks)
        part = whole[top : top + looks.shape[0], left : left + looks.shape[1]]
        np.testing.assert_array_equal(looks, part)


def test_coloured_pixels_are_counted_as_by_numpy() -> None:
    image = np.random.default_rng(6).integers(0, 256, (37, 53, 3), np.uint8)
    spread = np.ptp(image[::4, ::4].astype(int), axis=2)
    assert count_coloured(image, 4, 100) == np.count_nonzero(spread > 100)


def test_what_a_codec_makes_of_grey_is_grey() -> None:
    noise = grey_of(RNG.normal(120, 30, (90, 120)))
    assert is_monochrome(noise)
    coded = noise.astype(np.int64) + RNG.integers(-3, 4, noise.shape)
    assert is_monochrome(np.clip(coded, 0, 255).astype(np.uint8))


def test_a_person_in_colours_before_a_grey_wall_is_in_colours() -> None:
    shown = grey_of(RNG.normal(120, 30, (90, 120)))
    shown[30:60, 50:60] = 40, 70, 140
    assert not is_monochrome(shown)


@pytest.mark.parametrize("level", [0, 17, 128, 200, 255])
def test_plain_grey_in_a_picture_in_colours_has_no_chroma_and_no_texture(level: int) -> None:
    found = appearance(coloured(plain(level, level, level)), (3, 3, 10, 10))
    np.testing.assert_array_equal(found.reshape(-1, 3), np.tile((level, 128, 0), (100, 1)))


@pytest.mark.parametrize("one", range(1, 7))
def test_no_hue_looks_like_grey(one: int) -> None:
    """Blue, green, red and what two of them make, pale as clothes: two bins at least from the grey as light."""
    hue = [160 if one >> k & 1 else 90 for k in range(3)]
    lightness, chroma, _ = appearance(plain(*hue), (5, 5, 1, 1))[0, 0].astype(int)
    assert abs(chroma - 128) > 2 * BIN
    assert 90 < lightness < 160


@pytest.mark.parametrize(("slope", "step"), [(0.5, 0), (1.0, 1), (2.0, 2), (6.0, 3)])
def test_texture_has_four_steps_of_slope_across_and_along(slope: float, step: int) -> None:
    """Stripes; classes are numbered forth and back, so that those of one direction are 0 to 3 and 0, 7, 8, 15."""
    # Sobel's filter finds sin(1) |cos x| of a sine, 2 / pi of that on average
    stripes = grey_of(np.tile(128 + slope / (np.sin(1) * 2 / np.pi) * np.sin(np.arange(200)), (64, 1)))
    along = appearance(coloured(np.moveaxis(stripes, 0, 1)), (8, 8, 48, 160))[..., 2]
    across = appearance(coloured(stripes), (8, 8, 184, 30))[..., 2]
    assert np.median(along) == BIN * step
    assert np.median(across) == BIN * (0, 7, 8, 15)[step]


def test_without_colours_slopes_have_channels_of_their_own() -> None:
    stripes = grey_of(np.tile(128 + 5 * np.sin(np.arange(64)), (64, 1)))
    grey, across, along = np.moveaxis(appearance(stripes, (8, 8, 48, 48)), 2, 0)
    np.testing.assert_array_equal(grey, stripes[8:56, 8:56, 0])
    assert across.mean() == pytest.approx(10 * 5 * np.sin(1) * 2 / np.pi, rel=0.1)  # tenths of a grey level a px
    assert not along.any()


@pytest.fixture(scope="module")
def scene(body: BodyModel) -> Scene:
    return Scene((Person("one", body, bent(body)),), four_views((720, 576)))


@pytest.fixture(scope="module")
def views(scene: Scene) -> tuple[Image, ...]:
    """A person in rough cloth before smooth walls, all levels of both in one of 16 bins of grey."""
    black_and_white = np.full((len(scene.shapes) + 1, 3), 255.0)
    black_and_white[-1] = 0
    found = []
    for silhouette in painted(scene, black_and_white, noise=0.0):
        assert silhouette is not None
        inside = silhouette[..., 0] > 127
        found.append(grey_of(120 + np.where(inside, 7.0, 1.0) * RNG.choice((-1, 1), inside.shape)))
    return tuple(found)


def account_of(scene: Scene, images: tuple[Image, ...], q: Array) -> Account:
    """Of a pose, once the right one has taught what parts and walls look like."""
    evidence, synthesis = RegionEvidence(), CpuSynthesis()
    sight, contours = Sight(Frame(0, 0.0, images)), synthesis.contours(scene)
    everything = np.ones((len(scene.rig), len(scene.shapes)), dtype=np.bool_)
    memory = evidence.learned(None, sight, scene, contours, everything)
    return evidence.account(Comparison(scene, 0, synthesis, evidence.observe(sight, contours, memory)), q)


@pytest.mark.parametrize("in_colours", [False, True])
def test_cloth_tells_a_person_from_a_wall_of_the_same_grey(
    scene: Scene, body: BodyModel, views: tuple[Image, ...], in_colours: bool
) -> None:
    views = tuple(map(coloured, views)) if in_colours else views
    truth = scene.persons[0].q
    assert account_of(scene, views, truth).explained > 0.8  # slopes are averaged over the outline as well
    q = truth.copy()
    q[body.index("left_arm_abduction")] += np.radians(70)
    arm = body.parts_of("left_arm")
    assert account_of(scene, views, body.clamped(q)).of(arm).explained < 0.3


def test_plain_cloth_of_the_walls_grey_is_not_told(scene: Scene) -> None:
    """So that the test above bites."""
    walls = tuple(grey_of(np.full((576, 720), 120.0)) for _ in range(4))
    assert account_of(scene, walls, scene.persons[0].q).explained == 0
