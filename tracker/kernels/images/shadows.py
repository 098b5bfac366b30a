"""Which of the pixels that have changed are a shadow on the background."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Image

MARGIN = 6
"""Pixels that the smoothed pictures show beyond the area looked at; smoothing may spoil the outer two."""

ShadowRule = tuple[float, float, float, float, float, float]
"""Least share of the light left where the texture shows, and where it does not; largest share; largest departure of
a channel, grey levels; least correlation of the texture; width of the softest outline of an object, px."""


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
    native.without_shadows(now, plate, origin, moving, rule, mask)
