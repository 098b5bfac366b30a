"""The surroundings of the model in a view made smaller, for level sets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Literal

import cv2
import numpy as np

from tracker.foundation.arrays import Array32, Image, Mask, Region
from tracker.images.operations.appearance import appearance
from tracker.images.operations.level_set import (
    Codes,
    Densities,
    colour_codes,
    densities,
    signed_distance,
    texture_codes,
)
from tracker.images.sight import Sight
from tracker.kernels.pictures import cover_shares

Channels = Literal["appearance", "colours", "tensor"]
"""Lightness, chroma and texture in one table; or blue, green and red; or these and the structure tensor beside them."""


@dataclass(frozen=True)
class Reach:
    """Region of a view to examine."""

    around_px: float
    """Reach of a region outside of the model's outline, px of the image."""

    factor: int
    """Pixels of the image for one of the small picture, along each side."""

    channels: Channels
    """Features of a pixel."""


@dataclass(frozen=True)
class Around:
    """The model in a view made smaller, and the image there."""

    region: Region
    """Of the image, px; a whole number of small pixels."""

    factor: int
    """As in `Reach`."""

    codes: Codes
    """(h, w) features."""

    prior: Array32
    """(h, w) signed distance to the model's outline, px of the small picture, positive inside."""

    near: Mask
    """(h, w) where a region may be."""

    def taught(self, inside: Mask) -> Densities | None:
        """Densities inside of a region (h, w) and beside it; None if either is too small."""
        return densities(self.codes, inside, self.near & ~inside)

    def cut(self, mask: Mask) -> Mask:
        """(h, w) of a mask (H, W) of the whole image."""
        return _cut(mask, self.region, self.factor)

    def uncut(self, region: Mask, shape: tuple[int, ...]) -> Mask:
        """(H, W) of a whole image of such a shape, from (h, w)."""
        x, y, width, height = self.region
        mask = np.zeros(shape, dtype=np.bool_)
        mask[y : y + height, x : x + width] = cv2.resize(region.astype(np.float32), (width, height)) > 0.5
        return mask


def around(sight: Sight, v: int, silhouette: Mask, reach: Reach) -> Around | None:
    """The surroundings of a silhouette (H, W); None if image or silhouette are missing."""
    image = sight.frame.images[v]
    if image is None or not silhouette.any():
        return None
    wanted = _aligned(silhouette, int(reach.around_px) + 2 * reach.factor, reach.factor)
    key = Around, reach.factor, reach.channels
    region, codes = sight.once(key, v, wanted, partial(_encoded, image, reach))
    small_px = reach.around_px / reach.factor
    prior = signed_distance(_cut(silhouette, region, reach.factor), 2 * small_px)
    return Around(region, reach.factor, codes, prior, prior > -small_px)


def _cut(mask: Mask, region: Region, factor: int) -> Mask:
    """(h, w) small pixels of which half or more is in a mask.

    Taking the pixel in the corner for all of them put outlines half a small pixel down and to the right.
    """
    x, y, width, height = region
    shares = np.empty((height // factor, width // factor), dtype=np.float32)
    cover_shares(np.ascontiguousarray(mask[y : y + height, x : x + width]), factor, shares)
    covered: Mask = shares >= 0.5
    return covered


def _aligned(silhouette: Mask, margin: int, factor: int) -> Region:
    """The box of a silhouette with a margin, inside the image, its sides multiples of the factor."""
    x, y, width, height = cv2.boundingRect(silhouette.view(np.uint8))
    left, top = max(x - margin, 0) // factor * factor, max(y - margin, 0) // factor * factor
    right, bottom = min(x + width + margin, silhouette.shape[1]), min(y + height + margin, silhouette.shape[0])
    return left, top, (right - left) // factor * factor, (bottom - top) // factor * factor


def _encoded(image: Image, reach: Reach, region: Region) -> tuple[Region, Codes]:
    """The features of a part of an image made smaller."""
    x, y, width, height = region
    size = width // reach.factor, height // reach.factor
    if reach.channels == "appearance":
        looks = appearance(image, region)
        small = _smaller(looks, size)
        # of texture the classes are told, which have no mean
        small[..., 2] = looks[reach.factor // 2 :: reach.factor, reach.factor // 2 :: reach.factor, 2]
        return region, (colour_codes(small),)
    part = _smaller(image[y : y + height, x : x + width], size)
    return region, (colour_codes(part), texture_codes(part)) if reach.channels == "tensor" else (colour_codes(part),)


def _smaller(part: Image, size: tuple[int, int]) -> Image:
    """A part of an image of such a width and height, px."""
    return part if part.shape[1::-1] == size else cv2.resize(part, size, interpolation=cv2.INTER_AREA)
