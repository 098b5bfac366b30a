"""Images of monochrome cameras, in which texture takes the place of colours."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.arrays import Image, Region

# Every eighth pixel in both directions is enough.
_SAMPLING = 8

_ALIKE_GREY = 8
"""Channels that differ by less are of one grey: a codec makes up to 3 of none."""

_COLOURED_SHARE = 1e-3
"""Images of more colours than this are of a colour camera: of the least colourful one of `BODYTRACK_DATA`, grey walls
around a person, 2 % differ by more."""

_WINDOW_PX = 2.0
"""Standard deviation of the window that slopes are averaged over, as of the structure tensor in `densities`."""

_SLOPE_GREY = 1.6
"""Slope of 16 levels of a channel, grey levels a px: skin and walls have 0 to 2 of these 16 bins, floors and clothes up
to 8. With 1.2 or 1.6, and windows of 1.5 or 2 px, of 75 frames 19 to 23 had a limb in doubt, 92 by grey alone."""

# Rows and columns beside a region that its slopes, smoothed over three standard deviations, hang on.
_MARGIN = 1 + round(3 * _WINDOW_PX)
# Sum of the weights of Sobel's filter on either side, times the distance of the two.
_SOBEL = 8.0
# A bin is so many levels of a channel.
_BIN = 16.0


def is_monochrome(image: Image) -> bool:
    """Whether an image (h, w, 3) has no colours."""
    sampled = image[::_SAMPLING, ::_SAMPLING].astype(np.int16)
    spread = sampled.max(axis=2) - sampled.min(axis=2)
    return float(np.mean(spread > _ALIKE_GREY)) < _COLOURED_SHARE


def textured(image: Image, region: Region) -> Image:
    """A region of a monochrome image whose channels are grey level and mean slopes across and along the image.

    What colours tell of a picture has 16 levels of each channel; grey alone would be 16 levels in all, and skin and a
    floor are often of one. Slopes stand for texture (Rosenhahn et al. 2006, section 2.1, have the structure tensor);
    whole numbers throughout, so that a region is the same whatever is beside it.

    Args:
        image: BGR (h, w, 3) of equal channels.
        region: x, y, width and height, px.

    Returns:
        (height, width, 3), bins of 16 levels.
    """
    x, y, width, height = region
    left, top = max(x - _MARGIN, 0), max(y - _MARGIN, 0)
    beside = image[top : y + height + _MARGIN, left : x + width + _MARGIN]
    grey = cv2.extractChannel(np.ascontiguousarray(beside), 1)
    scale = _BIN / (_SLOPE_GREY * _SOBEL)
    slopes = (cv2.convertScaleAbs(slope, alpha=scale) for slope in cv2.spatialGradient(grey))
    means = [cv2.GaussianBlur(slope, (0, 0), _WINDOW_PX) for slope in slopes]
    merged: Image = cv2.merge([grey, *means])[y - top : y - top + height, x - left : x - left + width]
    return np.ascontiguousarray(merged)
