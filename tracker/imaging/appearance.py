"""What tells a person from what is behind: lightness, chroma and texture, as the three channels of a picture."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.arrays import Image, Region, frozen

# Chroma of a pixel from Cr and Cb (ITU-R BT.601): 1.05 red - 0.39 green - 0.66 blue, so that none of the primary and
# secondary colours has that of grey. Quarters: the sum has no rounding, on whatever processor.
_RED, _BLUE = 1.75, -1.0

_PALE = 40.0
"""Chroma, levels, up to which pale colours are told apart: 3 of 128 to a level near grey, less and less beyond. In
straight steps of 16, or of 8, a person before grey walls was 30 mm (18) off, with a joint off in 10 of 80 frames."""

_WINDOW = 7
"""Side of the square that slopes are averaged over, px; of persons some 300 px high forearms are 20 to 30 px wide."""

_SLOPES = 0.7, 1.4, 2.8
"""Mean slopes between the four steps of either direction, grey levels a px: of noise, skin, walls and floors."""

_ALIKE_GREY = 8
"""Channels that differ by less are of one grey: a codec makes up to 3 of none."""

_COLOURED_SHARE = 1e-3
"""Images of more colours than this are of a colour camera: of the least colourful one of `BODYTRACK_DATA`, grey walls
around a person, 2 % differ by more."""

# Every eighth pixel in both directions is enough for it.
_SAMPLING = 8
# Rows and columns beside a region that its texture hangs on.
_MARGIN = 1 + _WINDOW // 2
# Tenths of grey levels a px, from Sobel's filter: the sum of its weights on either side, times the distance of the two.
# So a bin of 16 levels of a slope's own channel is 1.6 grey levels a px wide.
_SOBEL_TENTHS = 10 / 8


def _tables() -> tuple[Image, ...]:
    """For `cv2.LUT`: chroma; four times the step of a slope, and the step; 16 times the class of two steps' sum.

    Classes go forth and back through the steps of one direction: those beside each other differ by one step, so that a
    window over them smooths what it should.
    """
    levels = np.arange(256)
    chroma = 128 + 127 * np.tanh((levels - 128) / _PALE)
    steps = np.searchsorted(10 * np.array(_SLOPES), levels)
    classes = np.arange(16).reshape(4, 4)
    classes[1::2] = classes[1::2, ::-1]
    return tuple(frozen(np.round(one), np.uint8) for one in (chroma, 4 * steps, steps, np.resize(16 * classes, 256)))


_CHROMA, _ACROSS, _ALONG, _CLASS = _tables()


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
    part = np.ascontiguousarray(image[top : y + height + _MARGIN, left : x + width + _MARGIN])
    lightness, red, blue = cv2.split(cv2.cvtColor(part, cv2.COLOR_BGR2YCrCb))
    across, along = (
        cv2.blur(cv2.convertScaleAbs(slope, alpha=_SOBEL_TENTHS), (_WINDOW, _WINDOW))
        for slope in cv2.spatialGradient(lightness)
    )
    if is_monochrome(image):
        merged: Image = cv2.merge([lightness, across, along])
    else:
        chroma = cv2.addWeighted(red, _RED, blue, _BLUE, 128.0 * (1.0 - _RED - _BLUE))
        texture = cv2.LUT(cv2.add(cv2.LUT(across, _ACROSS), cv2.LUT(along, _ALONG)), _CLASS)
        merged = cv2.merge([lightness, cv2.LUT(chroma, _CHROMA), texture])
    return np.ascontiguousarray(merged[y - top : y - top + height, x - left : x - left + width])


def is_monochrome(image: Image) -> bool:
    """Whether an image (h, w, 3) has no colours."""
    sampled = image[::_SAMPLING, ::_SAMPLING].astype(np.int16)
    spread = sampled.max(axis=2) - sampled.min(axis=2)
    return float(np.mean(spread > _ALIKE_GREY)) < _COLOURED_SHARE
