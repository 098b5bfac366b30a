"""Colours inside and outside of body parts: pixels as colour numbers, and tables of how often each colour occurs.

A colour is one of 16 x 16 x 16 bins of a picture's three channels: lightness, chroma and texture, see
`tracker.imaging.appearance`. Tables are kept per view and part: one table for a whole person is two to four times
worse, and no two cameras see the same colours.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tracker.arrays import Array32, Image, Integers, Mask, Numbers16
from tracker.kernels.compilation import compiled
from tracker.kernels.rows import region

N_COLOURS = 4096
"""16 levels of each channel."""

EVEN = 127
"""Entry of a posterior table that tells nothing; 0 is surely outside, 254 surely inside."""

HIDDEN = 255
"""Entry of the colours of something that hides the part: nothing can be told there, and nothing has to be."""

# Of the posterior.
_BINS = 16

# A colour is the hider's where it is so much more frequent than in the part, and no stray one.
_HIDES, _LEAST_HIDER = 3.0, 1e-3

LEAST_PIXELS = 20.0
"""Fewer pixels than this teach nothing: a table of a handful of colours calls every other one strange."""


class Picture(NamedTuple):
    """The colour numbers of all views where they matter."""

    codes: Numbers16
    """Regions of all views end to end, each row by row."""

    layout: Integers
    """(V, 5) start in `codes`; x, y, width and height of the region, px; width 0 for a missing view."""


class Tables(NamedTuple):
    """Shares of the colours, each table summing to 1, or to 0 where nothing was learnt."""

    inside: Array32
    """(V, P, 4096) of the pixels just inside the contour of a part."""

    outside: Array32
    """(V, P, 4096) of the background just outside of it."""

    hiders: Array32
    """(V, 4096) of the things that hide parts."""


@compiled
def encode(picture: Image, codes: Numbers16) -> None:
    """Writes the colour numbers of a picture (h, w, 3) to `codes` (h w,), row by row."""
    levels = picture.reshape(-1)
    # Functions, for operators widen whole numbers to 64 bits: ten times slower.
    half, most = np.uint16(4), np.uint16(240)
    for k in range(len(levels) // 3):
        first, second, third = np.uint16(levels[3 * k]), np.uint16(levels[3 * k + 1]), np.uint16(levels[3 * k + 2])
        high = np.left_shift(np.right_shift(first, half), np.uint16(8))
        codes[k] = np.bitwise_or(np.bitwise_or(high, np.bitwise_and(second, most)), np.right_shift(third, half))


@compiled
def colour_at(picture: Picture, v: int, x: float, y: float) -> int:
    """Colour number of the pixel nearest to a position in view v, -1 outside of the region."""
    column = int(np.floor(x + 0.5)) - picture.layout[v, region.LEFT]
    row = int(np.floor(y + 0.5)) - picture.layout[v, region.TOP]
    width = picture.layout[v, region.WIDTH]
    if column < 0 or row < 0 or column >= width or row >= picture.layout[v, region.HEIGHT]:
        return -1
    return int(picture.codes[picture.layout[v, region.START] + row * width + column])


@compiled
def _clamped(k: int) -> int:
    return min(max(k, 0), _BINS - 1)


@compiled
def spread_colours(counts: Integers, table: Array32, factor: float) -> None:
    """Adds colour counts (4096,), each spread 1-2-1 over its neighbours in all channels, times a factor.

    A Parzen window: 300 pixels are too few for 4096 bins. Beyond the end of a channel the weight stays in the last bin.
    """
    for colour in range(N_COLOURS):
        if counts[colour] == 0:
            continue
        high, middle, low = colour >> 8, colour >> 4 & 15, colour & 15
        share = factor * counts[colour] / 64.0
        for i in range(-1, 2):
            first = _clamped(high + i) << 8
            for j in range(-1, 2):
                second = first | _clamped(middle + j) << 4
                weight = share * ((2 - abs(i)) * (2 - abs(j)))
                for k in range(-1, 2):
                    table[second | _clamped(low + k)] += weight * (2 - abs(k))


@compiled
def learn_colours(counts: Integers, news: float, table: Array32) -> bool:
    """Moves a table (4096,) towards the shares of colours counted (4096,) by `news`, all the way if it is empty.

    Returns:
        Whether there were enough pixels.
    """
    # Whole numbers and comparisons: sums of fractions, which have an order, took most of the time of learning.
    total = 0
    for colour in range(N_COLOURS):
        total += counts[colour]
    if total < LEAST_PIXELS:
        return False
    rate = news if table.max() > 0.0 else 1.0
    for colour in range(N_COLOURS):
        table[colour] *= 1.0 - rate
    spread_colours(counts, table, rate / total)
    return True


@compiled
def _hides(hider: float, part: float) -> bool:
    return hider > _LEAST_HIDER and hider > _HIDES * part


def hides(hider: Array32, part: Array32) -> Mask:
    """Which colours are those of what hides a part, by the shares (...,) that they have of both."""
    found: Mask = (hider > _LEAST_HIDER) & (hider > _HIDES * part)
    return found


@compiled
def tabulate_posteriors(tables: Tables, rule: tuple[float, float], wanted: Mask, posteriors: Image) -> None:
    """Probability that a pixel of a colour lies inside, were both sides as likely, of some parts in some views.

    Args:
        tables: shares of the colours.
        rule: share that a colour never seen has; bound on the logarithm of the odds.
        wanted: (V, P) tables to fill.
        posteriors: (V, P, 4096) output, 254 times the probability; `HIDDEN` for colours of a thing that hides the part.
    """
    floor, most = rule
    low = 1.0 / (1.0 + np.exp(most))
    for v in range(wanted.shape[0]):
        for p in range(wanted.shape[1]):
            if not wanted[v, p]:
                continue
            for colour in range(N_COLOURS):
                if _hides(tables.hiders[v, colour], tables.inside[v, p, colour]):
                    posteriors[v, p, colour] = HIDDEN
                    continue
                inside = tables.inside[v, p, colour] + floor
                share = inside / (inside + tables.outside[v, p, colour] + floor)
                posteriors[v, p, colour] = int(254.0 * min(max(share, low), 1.0 - low) + 0.5)
