"""How likely what a pixel shows is inside and outside of a region: smoothed Parzen densities of colour and texture.

The densities p1 and p2 of Rosenhahn et al. 2006, section 2.1, with the texture channels of section 2.1's end: the
structure tensor (after Brox, Rousson, Deriche, Weickert, CAIP 2003), whose channels count as independent of the colour.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from tracker.foundation.arrays import Array32, Image, Mask, frozen

Codes = tuple[NDArray[np.uint16], ...]
"""For each kind of feature a number 0 to 4095 in every pixel (h, w): which of 16 x 16 x 16 bins it falls into."""

_BINS = 16
"""Of each channel."""

_FLOOR = 2e-4
"""Share that a value never seen has: one of 4096 bins by chance."""

_MOST_ODDS = 4.0
"""Bound on the logarithm of the odds of one pixel and kind of feature: no single one proves anything."""

_PARZEN_BINS = 0.8
"""Standard deviation of the Gaussian window: 13 grey levels, as 1-2-1 twice."""

_LEAST_PIXELS = 20
"""Fewer teach nothing."""

_TENSOR_PX = 2.0
"""Standard deviation of the window that the structure tensor is smoothed over."""

_SLOPE_LEVELS = 3.0
"""Slope of a bin of the tensor's square roots, grey levels a px."""


@dataclass(frozen=True)
class Densities:
    """Shares of the bins inside and outside; each table sums to 1."""

    tables: Array32
    """(F, 2, 4096) for each kind of feature, inside first."""

    @cached_property
    def odds(self) -> Array32:
        """(F, 4096) log p1 - log p2, bounded."""
        inside, outside = self.tables[:, 0] + _FLOOR, self.tables[:, 1] + _FLOOR
        return frozen(np.clip(np.log(inside / outside), -_MOST_ODDS, _MOST_ODDS), np.float32)

    def log_odds(self, codes: Codes) -> Array32:
        """(h, w) log p1 / p2 of every pixel; kinds of features count as independent."""
        total = np.take(self.odds[0], codes[0])
        for table, numbers in zip(self.odds[1:], codes[1:], strict=True):
            total += np.take(table, numbers)
        found: Array32 = total
        return found

    def log_shares(self, codes: Codes) -> Array32:
        """(h, w) log p1 of every pixel over that of a value never seen: where what is behind is known otherwise."""
        shares = np.log1p(self.tables[:, 0] / _FLOOR).clip(max=_MOST_ODDS)
        found: Array32 = np.sum([table[numbers] for table, numbers in zip(shares, codes, strict=True)], axis=0)
        return found

    def mixed(self, newer: Densities, news: float) -> Densities:
        """A running mean in which the newer ones have the share `news`."""
        return Densities(frozen((1 - news) * self.tables + news * newer.tables, np.float32))


def colour_codes(image: Image) -> NDArray[np.uint16]:
    """(h, w) bins of the colours of a BGR image (h, w, 3)."""
    top = (image >> 4).astype(np.uint16)
    codes: NDArray[np.uint16] = np.asarray(top[..., 0] << 8 | top[..., 1] << 4 | top[..., 2], dtype=np.uint16)
    return codes


def texture_codes(image: Image) -> NDArray[np.uint16]:
    """(h, w) bins of the structure tensor of a BGR image: square roots of Jxx and Jyy, signed one of Jxy."""
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    dx, dy = (slope.astype(np.float32) / 8 for slope in cv2.spatialGradient(grey))
    tensor = [cv2.GaussianBlur(product, (0, 0), _TENSOR_PX) for product in (dx * dx, dy * dy, dx * dy)]
    roots = [np.sign(channel) * np.sqrt(np.abs(channel)) / _SLOPE_LEVELS for channel in tensor]
    roots[2] += _BINS // 2
    across, along, both = (np.clip(root, 0, _BINS - 1).astype(np.uint16) for root in roots)
    codes: NDArray[np.uint16] = across << 8 | along << 4 | both
    return codes


def densities(codes: Codes, inside: Mask, outside: Mask) -> Densities | None:
    """Densities of what is seen inside and outside; None where either has too few pixels.

    Args:
        codes: of the features.
        inside: (h, w) pixels of the region.
        outside: (h, w) pixels beside it, those that it may be confused with.
    """
    if min(np.count_nonzero(inside), np.count_nonzero(outside)) < _LEAST_PIXELS:
        return None
    tables = [[_density(numbers[where]) for where in (inside, outside)] for numbers in codes]
    return Densities(frozen(tables, np.float32))


def _density(numbers: NDArray[np.uint16]) -> Array32:
    """(4096,) share of each bin, spread by the Parzen window."""
    counts = np.bincount(numbers, minlength=_BINS**3).reshape(_BINS, _BINS, _BINS)
    smooth = gaussian_filter(counts.astype(np.float32), _PARZEN_BINS, mode="nearest", truncate=3)
    shares: Array32 = (smooth / smooth.sum()).ravel()
    return shares
