"""A clean plate from the recording itself: what most of its images show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from tracker.foundation.arrays import Image, Mask
from tracker.images.operations.light import Light, light_of, sparse
from tracker.images.operations.masks import grown
from tracker.images.plate import Plate, changed
from tracker.kernels.changes import dominant_modes

N_SAMPLES = 25
"""Images, spread over a recording, that a plate is made of."""

# Colours that agree: six deviations of a noise of 2 grey levels.
_REACH = 12
# A place is free where so many images agree, and not so many others on something else: somebody may stand for most of
# the time and leave.
# See docs/lab/backdrops.md.
_MOST, _RIVALS = 0.6, 0.3


# Rows of all images that are looked at together: 25 images of 4K are 0.6 GiB, which need not be there twice.
_ROWS = 64
# What is not known is grown by this share of the longer side: 7 px of 720, for colours are smoothed and bodies sway.
_GROWN = 0.01


@dataclass(frozen=True)
class RecordedPlate:
    """A plate made of images with persons in them, and whether it can be one."""

    plate: Plate
    """Unknown where no colour is that of the scene without doubt."""

    moving: float
    """Share of the view that persons cover at some time: nearly nothing where nobody ever moves."""

    known: float
    """Of what persons cover in an image the share that lies where the plate knows: 1 where they walk about, less where
    they stay."""

    level: float
    """Median threshold of the images against the plate, grey levels."""


def recorded_plate(images: Sequence[Image]) -> RecordedPlate:
    """The dominant colour of every pixel, over images (h, w, 3) brought to the same light."""
    middle = np.median([sparse(image) for image in images], axis=0).astype(np.uint8)
    lights = [light_of(middle, sparse(image)) for image in images]
    shape, n = images[0].shape[:2], len(images)
    picture, counts, rivals = np.empty((*shape, 3), np.uint8), np.empty(shape, np.uint8), np.empty(shape, np.uint8)
    for top in range(0, shape[0], _ROWS):
        rows = slice(top, top + _ROWS)
        strips = (_lit(image[rows], light, top) for image, light in zip(images, lights, strict=True))
        dominant_modes(np.stack(list(strips)), _REACH, picture[rows], counts[rows], rivals[rows])
    masks, levels = np.empty((n, *shape), dtype=np.bool_), np.empty(n)
    for k, (image, light) in enumerate(zip(images, lights, strict=True)):
        _, masks[k], levels[k] = changed(_lit(image, light), Plate(picture))
    doubted = (counts < _MOST * n) | (rivals >= _RIVALS * n)
    unknown = _grown(doubted & masks.any(axis=0))
    covered_px, known_px = float(np.median(_sizes(masks))), float(np.median(_sizes(masks, ~unknown)))
    plate, moving = Plate(picture, unknown, recorded=True), float(masks.any(axis=0).mean())
    return RecordedPlate(plate, moving, known_px / max(covered_px, 1.0), float(np.median(levels)))


def _lit(part: Image, light: Light | None, top: int = 0) -> Image:
    """Rows of an image (h, w, 3), from `top` on, in the light that all have in common."""
    return np.ascontiguousarray(part) if light is None else light.on(part, (0, top))


def _sizes(masks: Mask, within: Mask | None = None) -> list[int]:
    """Pixels of each mask (n, h, w)."""
    return [int(np.count_nonzero(mask if within is None else mask & within)) for mask in masks]


def _grown(doubted: Mask) -> Mask:
    """Without specks, and wider by `_GROWN`."""
    opened = cv2.morphologyEx(doubted.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return grown(opened.view(np.bool_), _GROWN * max(doubted.shape))
