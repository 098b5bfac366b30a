"""Key patches: pieces of an image that are kept, and found again in others by least squares matching."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Integers, Mask
from tracker.kernels.patches.equations import Noise, Rule
from tracker.kernels.patches.splines import MARGIN, SplineImage


def key_side(half: int) -> int:
    """Side of the square of spline coefficients that a patch of 2 half + 1 pixels needs."""
    return 2 * (half + MARGIN) + 1


def cut_keys(image: SplineImage, centres: Integers, half: int, keys: Array32, inside: Mask) -> None:
    """Copies the coefficients around N whole pixels.

    Args:
        image: spline coefficients, width and height.
        centres: (N, 2) x, y px.
        half: the patch has 2 half + 1 pixels a side.
        keys: (N, side * side) written, row by row.
        inside: (N,) written: whether the patch lies within the image; keys of others stay as they are.
    """
    native.cut_keys(image, centres, half, keys, inside)


def match_keys(
    keys: Array32, which: Integers, search: SplineImage, found: Array, ended: Integers, rule: Rule, noise: Noise
) -> None:
    """Finds M key patches in an image; see `tracker.kernels.patches.matching.match_patches`.

    Args:
        keys: (N, side * side) from `cut_keys`.
        which: (M,) rows of the keys.
        search, rule, noise: as there.
        found: (M, 15) holds the starts, and the results after.
        ended: (M,) written: how each match ended.
    """
    native.match_keys(keys, which, search, found, ended, rule, noise)
