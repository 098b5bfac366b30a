"""Masks that are wider by a disc."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.foundation.arrays import Mask


def grown(mask: Mask, radius_px: float) -> Mask:
    """A mask (h, w) with all that is within a radius of it, rounded to pixels and at least one."""
    size = 2 * max(1, round(radius_px)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    found: Mask = cv2.dilate(mask.astype(np.uint8), disc) > 0
    return found
