"""Key patches: pieces of an image that are kept, and found again in others by least squares matching."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Array32, Integers, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.patches.equations import Noise, Rule, workspace
from tracker.kernels.patches.matching import match_patch
from tracker.kernels.patches.splines import MARGIN, SplineImage


@compiled
def key_side(half: int) -> int:
    """Side of the square of spline coefficients that a patch of 2 half + 1 pixels needs."""
    return 2 * (half + MARGIN) + 1


@compiled
def cut_keys(image: SplineImage, centres: Integers, half: int, keys: Array32, inside: Mask) -> None:
    """Copies the coefficients around N whole pixels.

    Args:
        image: spline coefficients, width and height.
        centres: (N, 2) x, y px.
        half: the patch has 2 half + 1 pixels a side.
        keys: (N, side * side) written, row by row.
        inside: (N,) written: whether the patch lies within the image; keys of others stay as they are.
    """
    flat, width, height = image
    side = key_side(half)
    reach = side // 2
    for k in range(len(centres)):
        x, y = centres[k, 0], centres[k, 1]
        inside[k] = x >= reach and y >= reach and x + reach < width and y + reach < height
        if inside[k]:
            for j in range(side):
                start = (y - reach + j) * width + x - reach
                keys[k, j * side : (j + 1) * side] = flat[start : start + side]


@compiled
def match_keys(
    keys: Array32, which: Integers, search: SplineImage, found: Array, ended: Integers, rule: Rule, noise: Noise
) -> None:
    """Finds M key patches in an image; see `tracker.kernels.patches.matching.match_patch`.

    Args:
        keys: (N, side * side) from `cut_keys`.
        which: (M,) rows of the keys.
        search, rule, noise: as there.
        found: (M, 15) holds the starts, and the results after.
        ended: (M,) written: how each match ended.
    """
    side = key_side(rule[0])
    work, at = workspace(rule[0], len(noise[2])), np.full(2, side // 2 * 1.0)
    for k in range(len(which)):
        template = keys[which[k]], side, side
        ended[k] = match_patch(template, search, at, found[k], rule, noise, work)
