"""What stands out in a frame: before plates, some of which do not know everywhere what is background."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.arrays import Image, Mask
from tracker.frame import Frame
from tracker.plate import Plate, departing

GAPS = (0.04,)
"""Widths of gaps in the foreground, tried before all that plates do not know counts as foreground; see `foregrounds`.

A trunk's 30 px of 720. With all at once V-Dance starts 446 mm off instead of 40; with these alone who stands still
but for the limbs (balancing, N-Stride seen from the front, R-Turn) is not found."""

# A limb that is missing in a mask is worse than a speck, which is nothing in space: less than in tracking.
_SIGMAS = 4.0
# Gaps are as wide as many pixels: they are closed in a picture so much smaller.
_SMALLER = 4


def foregrounds(frame: Frame, plates: tuple[Plate | None, ...], gap: float = 1.0) -> tuple[Mask | None, ...]:
    """What has changed (H, W) in each view, shadows included; None without a plate, or where everything differs.

    What looks like a shadow may be skin, and in space a shadow is no thicker than the floor it lies on.

    Args:
        frame: the images, and masks that the user brings.
        plates: of the views.
        gap: of what the plates do not know, gaps this wide between what has changed count as changed, too, in shares of
            the image's longer side; 1 for all of it.
    """
    found = []
    for v, (image, plate) in enumerate(zip(frame.images, plates, strict=True)):
        differing = None if image is None or plate is None else _differing(image, plate, gap)
        given = frame.mask(v)
        found.append(differing if given is None else given)
    return tuple(found)


def _differing(image: Image, plate: Plate, gap: float) -> Mask | None:
    """What has changed (H, W), and what the plate does not know in the gaps of that."""
    differing = departing(image, plate, _SIGMAS)
    if differing is None or plate.unknown is None:
        return differing
    sure = differing & ~plate.unknown
    return np.asarray(sure | (plate.unknown if gap >= 1 else plate.unknown & _closed(sure, gap)))


def _closed(mask: Mask, gap: float) -> Mask:
    """Without gaps of a share of the longer side; found in a small picture."""
    width, height = mask.shape[1] // _SMALLER, mask.shape[0] // _SMALLER
    small = cv2.resize(mask.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
    radius = max(1, round(gap / 2 * max(small.shape)))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    whole = cv2.morphologyEx(small, cv2.MORPH_CLOSE, disc)
    closed: Mask = cv2.resize(whole, mask.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    return closed
