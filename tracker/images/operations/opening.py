"""Opening of masks: what is thinner than two pixels goes, the rest stays where it is."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.foundation.arrays import Mask

# Opening with it takes noise away, and the seam between light and shade: single pixels and lines of one.
_SQUARE = np.ones((2, 2), np.uint8)


def opened(mask: Mask) -> Mask:
    """(h, w) all squares of 2x2 pixels that lie in a mask: without single pixels and lines of one.

    `cv2.MORPH_OPEN` erodes and dilates with an even square at the same anchor, which moves the mask by a pixel down and
    to the right, out of itself.
    """
    last, first = (1, 1), (0, 0)
    # beside the image nothing is set: a line of one along its border is no square
    left = cv2.erode(mask.astype(np.uint8), _SQUARE, anchor=last, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    found: Mask = cv2.dilate(left, _SQUARE, anchor=first) > 0
    return found
