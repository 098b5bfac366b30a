"""How the light of an image differs from that of its clean plate, and the plate in the image's light."""

from __future__ import annotations

import numpy as np

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Image, Mask

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
