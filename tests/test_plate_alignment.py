"""A plate of a camera that was turned a little is fitted to its images."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tracker.foundation.arrays import Array, Image
from tracker.images.plate import LEAST_INLIERS, aligned


def textured(seed: int, size: tuple[int, int] = (360, 480)) -> Image:
    """Blobs of many sizes and colours (h, w, 3)."""
    rng = np.random.default_rng(seed)
    picture = np.full((*size, 3), 110, dtype=np.uint8)
    for _ in range(500):
        centre = rng.integers(0, (size[1], size[0]))
        colour = tuple(int(level) for level in rng.integers(30, 200, 3))
        cv2.circle(picture, (int(centre[0]), int(centre[1])), int(rng.integers(3, 16)), colour, -1, cv2.LINE_AA)
    smooth: Image = cv2.GaussianBlur(picture, (3, 3), 0)
    return smooth


def turned(homography: Array, picture: Image) -> Image:
    seen: Image = cv2.warpPerspective(picture, homography, (480, 360), borderMode=cv2.BORDER_REPLICATE)
    return seen


TURN = np.array([[1.02, 0.03, -9.0], [-0.025, 0.985, 6.0], [3e-5, -2e-5, 1.0]])


@pytest.mark.parametrize("seed", [1, 2])
def test_a_turned_plate_in_other_light_comes_to_lie_on_the_image(seed: int) -> None:
    plate = textured(seed)
    image = np.clip(0.85 * turned(TURN, plate).astype(np.float64) + 14, 0, 255).astype(np.uint8)
    person = image.copy()
    person[100:300, 200:280] = (40, 60, 200)
    fitted, n_agree = aligned(plate, person)
    assert n_agree >= LEAST_INLIERS
    inner = np.zeros((360, 480), dtype=np.bool_)
    inner[25:-25, 25:-25] = True
    inner[95:305, 195:285] = False
    before = np.abs(plate.astype(int) - image)[inner]
    after = np.abs(fitted.astype(int) - image)[inner]
    assert np.percentile(before, 75) > 12
    assert np.median(after) <= 2
    assert np.percentile(after, 95) < 12
    # The person is not in the plate.
    assert np.abs(fitted[150:250, 210:270].astype(int) - person[150:250, 210:270]).max(axis=2).mean() > 40


def test_beyond_the_plate_the_image_itself_stands() -> None:
    plate = textured(3)
    shift = np.array([[1.0, 0, 60.0], [0, 1.0, 0], [0, 0, 1.0]])
    image = turned(shift, plate)
    image[:, :50] = 5
    fitted, _ = aligned(plate, image)
    assert (fitted[:, :50] == 5).all()


def test_a_plate_of_another_place_is_not_fitted() -> None:
    _, n_agree = aligned(textured(4), textured(5))
    assert n_agree < LEAST_INLIERS
    blank = np.full((360, 480, 3), 90, dtype=np.uint8)
    fitted, n_agree = aligned(blank, textured(4))
    assert n_agree == 0
    np.testing.assert_array_equal(fitted, textured(4))
