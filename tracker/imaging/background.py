"""Background subtraction with a clean plate."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from tracker.arrays import Array32, Image, Mask

Region = tuple[int, int, int, int]
"""x, y, width, height, px."""

# A shadow keeps the colour, loses up to 55 % of the light and lets the background's texture show. Grey trousers
# before a grey floor keep the colour too: where the texture is gone, only up to 20 % of loss is a shadow.
_DARKEST = 0.45
_DARKEST_WITHOUT_TEXTURE = 0.8
_CHROMA_GREY = 8.0
_TEXTURE_CORRELATION = 0.7
_WINDOW = (9, 9)
_SQUARE = np.ones((3, 3), np.uint8)
_DISC = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (7, 7))


def difference(image: Image, plate: Image) -> Image:
    """Largest channel difference (h, w) uint8 between an image and a plate (h, w, 3), lightly smoothed."""
    apart = cv2.absdiff(cv2.GaussianBlur(image, (3, 3), 0), cv2.GaussianBlur(plate, (3, 3), 0))
    largest: Image = _largest(apart)
    return largest


def _largest(picture: Any) -> Any:
    """The largest of the three channels (h, w, 3) -> (h, w); numpy takes ten times as long over an axis of three."""
    blue, green, red = cv2.split(picture)
    return cv2.max(cv2.max(blue, green), red)


def _summed(picture: Array32) -> Array32:
    """The sum of the three channels (h, w, 3) -> (h, w)."""
    total: Array32 = cv2.transform(picture, np.ones((1, 3), dtype=np.float32))
    return total


def threshold_level(image: Image, plate: Image, sigmas: float = 6.0, least: float = 14.0) -> float:
    """Threshold of a difference image from its own noise, grey levels.

    The median of the differences is the noise of the background, which covers most of the image; a sixteenth of
    the pixels is enough to find it.
    """
    apart = _largest(cv2.absdiff(image[::4, ::4], plate[::4, ::4]))
    return max(least, sigmas * float(np.median(apart)) / 0.954)


def changed(image: Image, plate: Image, region: Region | None = None, least: float = 14.0) -> tuple[Mask, Mask]:
    """Pixels (h, w) that differ from the plate, and those of them that are not its shadow: the moving foreground.

    Args:
        image, plate: BGR (h, w, 3) of the same size.
        region: x, y, width, height to look in, px; None for the whole image.
        least: smallest threshold, grey levels.

    Returns:
        All changed pixels, and the foreground cleaned of specks and small holes; both false outside the region.
    """
    full = image.shape[:2]
    level = threshold_level(image, plate, least=least)
    x, y, width, height = region or (0, 0, image.shape[1], image.shape[0])
    inside = slice(y, y + height), slice(x, x + width)
    image, plate = image[inside], plate[inside]
    moving = difference(image, plate) > level
    cleaned = cv2.morphologyEx((moving & ~_shadow(image, plate)).astype(np.uint8), cv2.MORPH_OPEN, _SQUARE)
    cleaned = cv2.morphologyEx(cleaned, cv2.MORPH_CLOSE, _DISC)
    anything, mask = np.zeros(full, dtype=np.bool_), np.zeros(full, dtype=np.bool_)
    anything[inside] = moving
    mask[inside] = _without_specks(cleaned)
    return anything, mask


def foreground(image: Image, plate: Image, region: Region | None = None) -> Mask:
    """The moving foreground (h, w) of `changed`."""
    return changed(image, plate, region)[1]


def _shadow(image: Image, plate: Image) -> Mask:
    """Pixels that are the plate darkened evenly in all channels, its texture still there."""
    now = cv2.GaussianBlur(image, (5, 5), 0).astype(np.float32)
    before = cv2.GaussianBlur(plate, (5, 5), 0).astype(np.float32)
    ratio = _summed(now * before) / np.maximum(_summed(before * before), 1.0)
    off = _largest(cv2.absdiff(now, cv2.merge([ratio, ratio, ratio]) * before))
    textured = _correlation(_summed(now) / np.float32(3), _summed(before) / np.float32(3)) > _TEXTURE_CORRELATION
    darkest = np.where(textured, _DARKEST, _DARKEST_WITHOUT_TEXTURE)
    shadow: Mask = (ratio > darkest) & (ratio < 0.97) & (off < _CHROMA_GREY)
    return shadow


def _correlation(now: Array32, before: Array32) -> Array32:
    """Normalized cross-correlation of two grey images in a small window, 0 where there is no texture."""

    def mean(values: Array32) -> Array32:
        filtered: Array32 = cv2.boxFilter(values, cv2.CV_32F, _WINDOW)
        return filtered

    a, b = mean(now), mean(before)
    covariance = mean(now * before) - a * b
    variance = np.maximum(mean(now * now) - a * a, 1.0) * np.maximum(mean(before * before) - b * b, 1.0)
    correlation: Array32 = covariance / np.sqrt(variance)
    return correlation


def _without_specks(mask: Image) -> Mask:
    """Regions of at least a fiftieth of the largest one."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    if count < 2:
        return mask.astype(np.bool_)
    areas = stats[:, cv2.CC_STAT_AREA].astype(np.float64)
    areas[0] = 0
    kept: Mask = (areas >= 0.02 * areas.max())[labels]
    return kept
