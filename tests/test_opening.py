"""Opening and growing of masks, as laws."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from tracker.foundation.arrays import Mask
from tracker.images.operations.masks import grown, opened


@pytest.fixture(params=range(5))
def mask(request: pytest.FixtureRequest) -> Mask:
    """Specks, lines and regions of all sizes, some of them cut by the border."""
    found: Mask = np.random.default_rng(request.param).random((24, 31)) < 0.4 + 0.1 * request.param
    return found


def test_an_opening_lies_in_its_mask(mask: Mask) -> None:
    assert not (opened(mask) & ~mask).any()


def test_an_opening_is_all_squares_of_two_that_lie_in_the_mask(mask: Mask) -> None:
    expected = np.zeros_like(mask)
    for row, column in np.ndindex(mask.shape[0] - 1, mask.shape[1] - 1):
        square = np.s_[row : row + 2, column : column + 2]
        expected[square] |= mask[square].all()
    assert expected.any()
    np.testing.assert_array_equal(opened(mask), expected)


def test_an_opening_has_nothing_left_to_open(mask: Mask) -> None:
    np.testing.assert_array_equal(opened(opened(mask)), opened(mask))


@pytest.mark.parametrize(("flipped", "size"), [(np.flipud, 2), (np.fliplr, 2), (np.flipud, 9), (np.fliplr, 9)])
def test_a_square_stays_where_it_is_whichever_way_it_is_seen(flipped: Callable[[Mask], Mask], size: int) -> None:
    square = np.zeros((30, 40), dtype=np.bool_)
    square[3 : 3 + size, 5 : 5 + size] = True
    np.testing.assert_array_equal(opened(square), square)
    np.testing.assert_array_equal(opened(flipped(square)), flipped(square))


def test_pixels_and_lines_of_one_go_also_at_the_border() -> None:
    lines = np.zeros((12, 12), dtype=np.bool_)
    lines[0], lines[:, -1], lines[5, 2:9], lines[8, 8] = True, True, True, True
    assert not opened(lines).any()


@pytest.mark.parametrize("radius_px", [0.0, 1.0, 3.4, 6.0])
def test_a_grown_mask_holds_what_is_near_and_nothing_that_is_far(radius_px: float) -> None:
    mask = np.random.default_rng(3).random((40, 50)) < 0.01
    far_px = distance_transform_edt(~mask)
    within = max(1, round(radius_px))
    found = grown(mask, radius_px)
    # discs of pixels: cv2's are up to a pixel narrower between the axes
    assert found[far_px <= within - 1].all()
    assert not found[far_px > within + 0.5].any()
