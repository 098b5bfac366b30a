"""A clean plate from the recording itself: what most of its images show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from tracker.arrays import Image, Mask
from tracker.imaging.light import light_of, sparse
from tracker.kernels.images.modes import dominant_modes
from tracker.plate import Plate, changed

N_SAMPLES = 25
"""Images, spread over a recording, that a plate is made of."""

# Colours that agree: six deviations of a noise of 2 grey levels.
_REACH = 12
# A place is free where so many images agree, and not so many others on something else: somebody may stand for most of
# the time and leave.
_MOST, _RIVALS = 0.6, 0.3


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
    pile = np.empty((len(images), *images[0].shape), dtype=np.uint8)
    for k, image in enumerate(images):
        light = light_of(middle, sparse(image))
        pile[k] = image if light is None else light.on(image)
    shape = images[0].shape[:2]
    picture, counts, rivals = np.empty((*shape, 3), np.uint8), np.empty(shape, np.uint8), np.empty(shape, np.uint8)
    dominant_modes(pile, _REACH, picture, counts, rivals)
    found = [changed(image, Plate(picture)) for image in pile]
    masks = np.array([one.foreground for one in found])
    doubted = (counts < _MOST * len(pile)) | (rivals >= _RIVALS * len(pile))
    unknown = _grown(doubted & masks.any(axis=0))
    covered_px, known_px = (float(np.median(part.sum(axis=(1, 2)))) for part in (masks, masks & ~unknown))
    level = float(np.median([one.level for one in found]))
    moving = float(masks.any(axis=0).mean())
    return RecordedPlate(Plate(picture, unknown, recorded=True), moving, known_px / max(covered_px, 1.0), level)


def _grown(doubted: Mask) -> Mask:
    """Without specks, and wider by `_GROWN`."""
    opened = cv2.morphologyEx(doubted.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    radius = max(1, round(_GROWN * max(doubted.shape)))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    grown: Mask = cv2.dilate(opened, disc) > 0
    return grown
