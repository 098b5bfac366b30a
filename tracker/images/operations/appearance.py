"""What tells a person from what is behind: lightness, chroma and texture, as the three channels of a picture."""

from __future__ import annotations

from functools import reduce

import cv2
import numpy as np

from tracker.foundation.arrays import Image, Region, frozen
from tracker.kernels.changes import mark_appearance

# Chroma of a pixel in quarters of a level from Cr and Cb (ITU-R BT.601): a fourth of it is 1.05 red - 0.39 green - 0.66
# blue, so that none of the primary and secondary colours has that of grey.
_RED, _BLUE = 7, -4

_PALE = 40.0
"""Chroma, levels, up to which pale colours are told apart: 3 of 128 to a level near grey, less and less beyond. In
straight steps a person before grey walls was 30 mm (18) off, with a joint off in 10 of 80 frames."""

_WINDOW = 7
"""Side of the square that slopes are averaged over, px; of persons some 300 px high forearms are 20 to 30 px wide."""

# See docs/lab/colours.md.
_SLOPES = 0.7, 1.4, 2.8
"""Mean slopes between the four steps of either direction, grey levels a px: of noise, skin, walls and floors."""

_ALIKE_GREY = 8
"""Channels that differ by less are of one grey: a codec makes up to 3 of none."""

_COLOURED_SHARE = 1e-3
"""Images of more colours than this are of a colour camera: of the least colourful one of `BODYTRACK_DATA`, grey walls
around a person, 3 % differ by more."""

# Every eighth pixel in both directions is enough for it.
_SAMPLING = 8
# Rows and columns beside a region that its texture hangs on.
_MARGIN = 1 + _WINDOW // 2
# Tenths of grey levels a px, from Sobel's filter: the sum of its weights on either side, times the distance of the two.
# So a bin of 16 levels of a slope's own channel is 1.6 grey levels a px wide.
_SOBEL_TENTHS = 10 / 8


def _tables() -> tuple[Image, Image, Image]:
    """Chroma of quarters from the least on; step of a slope; 16 times the class of a step across and one along.

    Classes go forth and back through the steps of one direction: those beside each other differ by one step, so that a
    window over them smooths what it should.
    """
    quarters = np.arange(255 * _BLUE, 255 * _RED + 1) - 128 * (_RED + _BLUE)
    chroma = 128 + 127 * np.tanh(np.clip(np.rint(quarters / 4), -128, 127) / _PALE)
    steps = np.searchsorted(10 * np.array(_SLOPES), np.arange(256))
    classes = 16 * np.arange(16).reshape(4, 4)
    classes[1::2] = classes[1::2, ::-1]
    return frozen(np.round(chroma), np.uint8), frozen(steps, np.uint8), frozen(classes.ravel(), np.uint8)


_TABLES = _tables()


def appearance(image: Image, region: Region) -> Image:
    """A region of an image whose channels are lightness, chroma and texture.

    Of 16 levels each, they tell more than 16 levels of blue, green and red, which are lightness for the most part, and
    skin and a floor often have the same. Texture are mean slopes across and along (Rosenhahn et al. 2006, section 2.1,
    have the structure tensor), four steps of each; where there are no colours each has a channel of its own. Whole
    numbers, so that a region is the same whatever is looked at beside it.

    Args:
        image: BGR (h, w, 3).
        region: x, y, width and height, px.

    Returns:
        (height, width, 3).
    """
    x, y, width, height = region
    left, top = max(x - _MARGIN, 0), max(y - _MARGIN, 0)
    part = image[top : y + height + _MARGIN, left : x + width + _MARGIN]
    colours = cv2.cvtColor(part, cv2.COLOR_BGR2YCrCb)
    lightness = cv2.extractChannel(colours, 0)
    across, along = (
        cv2.blur(cv2.convertScaleAbs(slope, alpha=_SOBEL_TENTHS), (_WINDOW, _WINDOW))
        for slope in cv2.spatialGradient(lightness)
    )
    if is_monochrome(image):
        merged: Image = cv2.merge([lightness, across, along])
        return np.ascontiguousarray(merged[y - top : y - top + height, x - left : x - left + width])
    looks = np.empty((height, width, 3), dtype=np.uint8)
    corner, weights = (x - left, y - top), (_RED, _BLUE, -255 * _BLUE)
    mark_appearance(colours, across, along, corner, weights, _TABLES, looks)
    return looks


def is_monochrome(image: Image) -> bool:
    """Whether an image (h, w, 3) has no colours."""
    channels = cv2.split(np.ascontiguousarray(image[::_SAMPLING, ::_SAMPLING]))
    brightest, darkest = reduce(cv2.max, channels), reduce(cv2.min, channels)
    coloured = cv2.countNonZero(cv2.compare(cv2.subtract(brightest, darkest), _ALIKE_GREY, cv2.CMP_GT))
    return bool(coloured < _COLOURED_SHARE * brightest.size)
