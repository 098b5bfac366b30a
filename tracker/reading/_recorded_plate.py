"""A clean plate from the recording itself: what most of its images show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from tracker.arrays import Image
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


@dataclass(frozen=True)
class RecordedPlate:
    """A plate made of images with persons in them, and whether it can be one."""

    picture: Image
    """(h, w, 3)."""

    moving: float
    """Share of an image that persons cover, usually: nearly nothing where nobody ever moves."""

    undecided: float
    """Places where no colour is that of the scene without doubt, as a share of what persons cover in an image: small
    where they walk about, large where they stay."""

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
    plate = Plate(picture)
    found = [changed(image, plate) for image in pile]
    masks = np.array([one.foreground for one in found])
    doubted = (counts < _MOST * len(pile)) | (rivals >= _RIVALS * len(pile))
    undecided = cv2.morphologyEx((doubted & masks.any(axis=0)).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3)))
    covered_px = float(np.median(masks.sum(axis=(1, 2))))
    level = float(np.median([one.level for one in found]))
    return RecordedPlate(picture, covered_px / counts.size, float(undecided.sum()) / max(covered_px, 1.0), level)
