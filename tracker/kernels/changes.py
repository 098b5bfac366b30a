"""Differences of an image from a plate of the empty scene, and the effects of light and shadows on both."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Image, Mask

# What differs between an image and a plate, and which regions of it are large enough to be an object.


def mark_changes(image: Image, plate: Image, origin: tuple[int, int], level: float, moving: Image) -> None:
    """Marks the pixels where a channel differs by more than a level.

    Args:
        image: (h + 2, w + 2, 3) a part of the image with a border of a pixel, which is left out.
        plate: (H, W, 3) the whole plate.
        origin: pixel (x, y) of the part's upper left corner, without the border.
        level: grey levels.
        moving: (h, w) output: 1 at such pixels, 0 elsewhere.
    """
    native.mark_changes(image, plate, origin, level, moving)


def median_level(picture: Image) -> float:
    """Median of the grey levels of a picture (h, w)."""
    return native.median_level(picture)


def large_regions(labels: NDArray[np.int32], n_labels: int, least: float, mask: NDArray[np.bool_]) -> None:
    """Marks the regions that are not much smaller than the largest one.

    Args:
        labels: (h, w) number of each pixel's region, 0 for none.
        n_labels: number of regions and one.
        least: share of the largest region's area.
        mask: (h, w) output.
    """
    native.large_regions(labels, n_labels, least, mask)


def mark_appearance(
    image: Image,
    corner: tuple[int, int],
    weights: tuple[int, int, int],
    chroma: Image,
    slopes: tuple[int, int, int],
    grey: bool,
    looks: Image,
) -> None:
    """Lightness, chroma and the class of texture of every pixel of a region.

    Lightness, Cr and Cb are those of ITU-R BT.601; slopes are Sobel's of the lightness, their sizes averaged over 7 x 7
    px. Beyond the image both are mirrored.

    Args:
        image: (H, W, 3) BGR.
        corner: pixel (x, y) of the region's upper left corner.
        weights: of Cr and of Cb in the place looked up for chroma, and what is added to it, so that none is below 0.
        chroma: (K,) by place.
        slopes: largest of each of the first three steps of a slope, tenths of a grey level a px.
        grey: whether mean slopes across and along take the place of chroma and class.
        looks: (h, w, 3) output.
    """
    native.mark_appearance(image, corner, weights, chroma, slopes, grey, looks)


def count_coloured(image: Image, spacing: int, level: int) -> int:
    """Of every so many pixels of an image (h, w, 3), in both directions, those whose channels differ by more."""
    return native.count_coloured(image, spacing, level)


# Changed pixels that are a shadow on the background.

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


# Difference of light between an image and its clean plate, and the plate in the image's light.

DARK = 6.0
"""Grey levels added before ratios are taken: where there is hardly any light, noise decides them."""


def block_ratios(now: Image, plate: Image, size: int, step: int) -> Array:
    """Median log ratio of image and plate in square blocks.

    Args:
        now: (h, w, 3) image.
        plate: (h, w, 3) its plate.
        size: side of a block, px; what is left over at the right and below is left out.
        step: take every so many pixels of a block's row, and of its column.

    Returns:
        (h // size, w // size, 3).
    """
    ratios = np.empty((now.shape[0] // size, now.shape[1] // size, 3))
    native.block_ratios(now, plate, size, step, ratios)
    return ratios


def smooth_surface(ratios: Array, least: float, n_steps: int, stride: int) -> Array:
    """The quadratic surface that most blocks agree with, by iteratively weighted least squares (Cauchy's weights).

    Args:
        ratios: (n, m, 3) log ratios of blocks.
        least: smallest departure that weighs a half.
        n_steps: number of iterations.
        stride: take every so many blocks in both directions.

    Returns:
        (n, m, 3) the surface; one weight serves the three channels of a block.
    """
    surface = np.empty_like(ratios)
    native.smooth_surface(ratios, least, n_steps, stride, surface)
    return surface


def connected_blocks(departures: Array, most: float) -> Mask:
    """Blocks near the surface, and those that a way of small steps from block to block leads to.

    Light falls off smoothly, however far; the outline of a person is a step.

    Args:
        departures: (n, m, 3) log ratios of blocks less the surface.
        most: largest departure of a block to begin with, and largest step to one of the four neighbours.

    Returns:
        (n, m).
    """
    reached = np.empty(departures.shape[:2], dtype=np.bool_)
    native.connected_blocks(departures, most, reached)
    return reached


def relight(picture: Image, gains: Array32, size: float, geometry: tuple[int, int, int], lit: Image) -> None:
    """A part of a plate in another light.

    Args:
        picture: (h, w, 3) part of the plate.
        gains: (n, m, 3) ratio of the light in each block; between the blocks' centres it is bilinear, beyond the
            outermost ones it is theirs.
        size: side of a block, px of the plate.
        geometry: place (x, y) in the plate of the part's first pixel, and pixels of the plate from one to the next.
        lit: (h, w, 3) output.
    """
    native.relight(picture, gains, size, geometry, lit)


def dominant_modes(pile: NDArray[np.uint8], reach: int, plate: Image, counts: Image, rivals: Image) -> None:
    """The colour that most pictures agree with, and how many do.

    A mean would mix persons into it, and a median takes one where he stands for half of the time in many colours.

    Args:
        pile: (n, h, w, 3) pictures, less than 256.
        reach: largest departure in any channel of colours that agree, grey levels.
        plate: (h, w, 3) output: mean of those that agree.
        counts: (h, w) output: their number.
        rivals: (h, w) output: number of those that agree on a colour of the others, at most.
    """
    native.dominant_modes(pile, reach, plate, counts, rivals)
