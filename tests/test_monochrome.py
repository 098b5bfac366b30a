"""Images without colours: how they are told, and what region evidence sees in them instead."""

from __future__ import annotations

import numpy as np
import pytest
from observations import bent, four_views
from painted import painted

from tracker.account import Account
from tracker.arrays import Array, Image, Region
from tracker.body import BodyModel
from tracker.comparison import Comparison
from tracker.evidence.regions import RegionEvidence
from tracker.frame import Frame
from tracker.imaging.monochrome import is_monochrome, textured
from tracker.scene import Person, Scene
from tracker.sight import Sight
from tracker.synthesis.cpu import CpuSynthesis

RNG = np.random.default_rng(3)


def grey_of(levels: Array) -> Image:
    return np.repeat(np.clip(np.round(levels), 0, 255).astype(np.uint8)[..., None], 3, axis=2)


@pytest.fixture(scope="module")
def noise() -> Image:
    return grey_of(RNG.normal(120, 30, (90, 120)))


def test_what_a_codec_makes_of_grey_is_grey(noise: Image) -> None:
    assert is_monochrome(noise)
    coded = noise.astype(np.int64) + RNG.integers(-3, 4, noise.shape)
    assert is_monochrome(np.clip(coded, 0, 255).astype(np.uint8))


def test_a_person_in_colours_before_a_grey_wall_is_in_colours(noise: Image) -> None:
    shown = noise.copy()
    shown[30:60, 50:60] = 40, 70, 140
    assert not is_monochrome(shown)


@pytest.mark.parametrize("region", [(0, 0, 120, 90), (31, 17, 40, 50), (0, 40, 9, 50), (100, 0, 20, 3), (60, 88, 1, 2)])
def test_a_region_is_that_of_the_whole_picture(noise: Image, region: Region) -> None:
    x, y, width, height = region
    whole = textured(noise, (0, 0, 120, 90))
    np.testing.assert_array_equal(textured(noise, region), whole[y : y + height, x : x + width])


def test_channels_are_grey_and_slopes_across_and_along() -> None:
    stripes = grey_of(np.tile(100 + 10 * np.sin(np.arange(64)), (64, 1)))
    grey, across, along = np.moveaxis(textured(stripes, (8, 8, 48, 48)), 2, 0)
    np.testing.assert_array_equal(grey, stripes[8:56, 8:56, 0])
    # mean slope of the sine, by Sobel's filter 10 sin(1) |cos x|, at 16 levels for 1.6 grey levels a px
    assert across.mean() == pytest.approx(10 * np.sin(1) * (2 / np.pi) * 16 / 1.6, rel=0.05)
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


def test_cloth_tells_a_person_from_a_wall_of_the_same_grey(
    scene: Scene, body: BodyModel, views: tuple[Image, ...]
) -> None:
    truth = scene.persons[0].q
    assert account_of(scene, views, truth).explained > 0.8  # slopes are averaged over the outline as well
    q = truth.copy()
    q[body.index("left_arm_abduction")] += np.radians(70)
    arm = body.parts_of("left_arm")
    assert account_of(scene, views, body.clamped(q)).of(arm).explained < 0.3


def test_a_view_in_colours_is_read_by_them(scene: Scene, views: tuple[Image, ...]) -> None:
    """In the same picture with a corner in colours the person cannot be told from the walls."""
    corner = tuple(image.copy() for image in views)
    for image in corner:
        image[:60, :60] = 40, 70, 140
    assert account_of(scene, corner, scene.persons[0].q).explained < 0.1
