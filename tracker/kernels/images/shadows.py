"""Which of the pixels that have changed are a shadow on the background."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Image
from tracker.kernels.compilation import compiled
from tracker.kernels.images.linking import Pixels
from tracker.kernels.images.texture import correlation, sum_columns

# Half the distance over which the ratio's slope is taken, px.
_STEP = 2
MARGIN = 6
"""Pixels that the smoothed pictures show beyond the area looked at; smoothing may spoil the outer two."""

# A region is an object or a shadow as a whole where so much of its outline is sharp or hardly any is; else, when
# clothes and their shadow look alike and meet, each part of it is what the outline beside it is.
_MOSTLY, _HARDLY = 0.5, 0.2

# What a pixel is taken for while the image is classified.
_UNCHANGED, _OBJECT, _UNDECIDED, _SHADOW, _REGION, _SHARP_REGION = range(6)

ShadowRule = tuple[float, float, float, float, float, float]
"""Least share of the light left where the texture shows, and where it does not; largest share; largest departure of
a channel, grey levels; least correlation of the texture; width of the softest outline of an object, px."""


@compiled
def without_shadows(
    now: Image, plate: Image, origin: tuple[int, int], moving: Image, rule: ShadowRule, mask: Image
) -> None:
    """The changed pixels that are no shadow.

    A shadow is the plate darkened alike in all channels. Such a pixel is a shadow where the plate's texture still
    shows or where it is hardly darker. The others, where a smooth floor and smooth clothes look the same, are
    judged region by region by their outline: the light returns softly at the border of a shadow, within 4 px at
    the border of an object (camera and smoothing).

    Args:
        now: (h + 2 m, w + 2 m, 3) smoothed image of an area with m = `MARGIN` px around it.
        plate: (H + 2 m, W + 2 m, 3) smoothed plate of the whole image.
        origin: pixel (x, y) of the area's upper left corner.
        moving: (h, w) non-zero where the image has changed.
        rule: see `ShadowRule`.
        mask: (h, w) output: 1 on objects, 0 elsewhere.
    """
    height, width = moving.shape
    before = plate[origin[1] :, origin[0] :]
    regions = np.empty(height * width, dtype=np.int32)
    n = 0
    sums = np.zeros((width + 2 * MARGIN, 5), dtype=np.int64)
    known = np.full(width + 2 * MARGIN, -2, dtype=np.int64)
    for y in range(height):
        for x in range(width):
            mask[y, x] = _UNCHANGED
            if not moving[y, x]:
                continue
            ratio = _shadow_ratio(now, before, x + MARGIN, y + MARGIN, rule)
            if ratio <= 0.0:
                mask[y, x] = _OBJECT
            elif ratio > rule[1]:
                mask[y, x] = _SHADOW
            else:
                sum_columns(now, before, x + MARGIN, y + MARGIN, known, sums)
                if correlation(sums, x + MARGIN) > rule[4]:
                    mask[y, x] = _SHADOW
                else:
                    mask[y, x] = _UNDECIDED
                    regions[n] = y * width + x
                    n += 1
    queue, border = np.empty(n, dtype=np.int32), np.empty((n, 2), dtype=np.int32)
    for i in range(n):
        if mask[regions[i] // width, regions[i] % width] == _UNDECIDED:
            _judge_region(now, before, regions[i], rule, mask, (queue, border))
    for y in range(height):
        for x in range(width):
            mask[y, x] = mask[y, x] == _OBJECT or mask[y, x] == _SHARP_REGION


@compiled
def _products(now: Image, before: Image, x: int, y: int) -> tuple[np.float32, np.float32]:
    """Sums over the channels of image times plate and of plate times plate."""
    both, square = np.float32(0), np.float32(0)
    for c in range(3):
        a, b = np.float32(now[y, x, c]), np.float32(before[y, x, c])
        both += a * b
        square += b * b
    return both, max(square, np.float32(1))


@compiled
def _ratio(now: Image, before: Image, x: int, y: int) -> float:
    """Share of the plate's light that is left, by least squares over the channels."""
    both, square = _products(now, before, x, y)
    return float(both / square)


@compiled
def _shadow_ratio(now: Image, before: Image, x: int, y: int, rule: ShadowRule) -> float:
    """Share of the light that is left if the pixel may be a shadow, else 0."""
    both, square = _products(now, before, x, y)
    if not rule[0] * square < both < rule[2] * square:
        return 0.0
    for c in range(3):
        if abs(now[y, x, c] * square - before[y, x, c] * both) >= rule[3] * square:
            return 0.0
    return float(both / square)


@compiled
def _judge_region(
    now: Image, before: Image, start: int, rule: ShadowRule, mask: Image, scratch: tuple[Pixels, Pixels]
) -> None:
    """Finds the 4-connected undecided region around a pixel and decides it by its outline.

    Args:
        now, before: smoothed image and plate.
        start: index of the pixel.
        rule: see `ShadowRule`.
        mask: (h, w) classes; those of the region are set.
        scratch: room for (N,) and (N, 2).
    """
    queue, border = scratch
    height, width = mask.shape
    queue[0] = start
    mask[start // width, start % width] = _REGION
    end, total = 1, 0.0
    i = 0
    while i < end:
        x, y = queue[i] % width, queue[i] // width
        total += _ratio(now, before, x + MARGIN, y + MARGIN)
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            u, v = x + dx, y + dy
            if 0 <= u < width and 0 <= v < height and mask[v, u] == _UNDECIDED:
                mask[v, u] = _REGION
                queue[end] = v * width + u
                end += 1
        i += 1
    # The ratio rises over the width of the outline from the region's to 1.
    steepest = (1 - total / end) / rule[5]
    outline = sharp = 0
    for i in range(end):
        x, y = queue[i] % width, queue[i] // width
        if _at_outline(mask, x, y):
            is_sharp = _beside_object(mask, x, y) or _slope(now, before, x + MARGIN, y + MARGIN) > steepest
            border[outline, 0], border[outline, 1] = queue[i], is_sharp
            outline += 1
            sharp += is_sharp
    if sharp >= _MOSTLY * outline:
        verdict = _SHARP_REGION
    elif sharp < _HARDLY * outline:
        verdict = _SHADOW
    else:
        _divide_region(mask, border[:outline], queue)
        return
    for i in range(end):
        mask[queue[i] // width, queue[i] % width] = verdict


@compiled
def _divide_region(mask: Image, border: Pixels, queue: Pixels) -> None:
    """Every pixel of a region is taken for what the outline is where it is nearest.

    Args:
        mask: (h, w) classes; those of the region are set.
        border: (n, 2) pixels of the outline, and whether it is sharp there.
        queue: scratch.
    """
    height, width = mask.shape
    end = len(border)
    for i in range(end):
        queue[i] = border[i, 0]
        mask[border[i, 0] // width, border[i, 0] % width] = _SHARP_REGION if border[i, 1] else _SHADOW
    i = 0
    while i < end:
        x, y = queue[i] % width, queue[i] // width
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            u, v = x + dx, y + dy
            if 0 <= u < width and 0 <= v < height and mask[v, u] == _REGION:
                mask[v, u] = mask[y, x]
                queue[end] = v * width + u
                end += 1
        i += 1


@compiled
def _at_outline(mask: Image, x: int, y: int) -> bool:
    """Whether one of the four neighbours lies outside of the region."""
    height, width = mask.shape
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        u, v = x + dx, y + dy
        if not (0 <= u < width and 0 <= v < height and mask[v, u] == _REGION):
            return True
    return False


@compiled
def _beside_object(mask: Image, x: int, y: int) -> bool:
    """Whether one of the eight neighbours is surely an object."""
    height, width = mask.shape
    for v in range(max(y - 1, 0), min(y + 2, height)):
        for u in range(max(x - 1, 0), min(x + 2, width)):
            if mask[v, u] == _OBJECT:
                return True
    return False


@compiled
def _slope(now: Image, before: Image, x: int, y: int) -> float:
    """Slope of the ratio of the light, 1/px."""
    across = _ratio(now, before, x + _STEP, y) - _ratio(now, before, x - _STEP, y)
    down = _ratio(now, before, x, y + _STEP) - _ratio(now, before, x, y - _STEP)
    return float(np.sqrt(across * across + down * down) / (2 * _STEP))
