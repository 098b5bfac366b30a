"""Colours inside and outside of body parts: pixels as colour numbers, and tables of how often each colour occurs.

A colour is one of 16 x 16 x 16 bins of a picture's three channels: lightness, chroma and texture, see
`images.operations.appearance`. Tables are kept per view and part: one table for a whole person is two to four times
worse, and no two cameras see the same colours.
"""

from __future__ import annotations

from typing import NamedTuple

import tracker._native as native
from tracker.foundation.arrays import Array32, Image, Integers, Mask, Numbers16

N_COLOURS = 4096
"""16 levels of each channel."""

EVEN = 127
"""Entry of a posterior table that tells nothing; 0 is surely outside, 254 surely inside."""

HIDDEN = 255
"""Entry of the colours of something that hides the part: nothing can be told there, and nothing has to be."""

# A colour is the hider's where it is so much more frequent than in the part, and no stray one.
_HIDES, _LEAST_HIDER = 3.0, 1e-3


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


def encode(picture: Image, codes: Numbers16) -> None:
    """Writes the colour numbers of a picture (h, w, 3) to `codes` (h w,), row by row."""
    native.encode(picture, codes)


def learn_colours(counts: Integers, news: float, table: Array32) -> bool:
    """Moves a table (4096,) towards the shares of colours counted (4096,) by `news`, all the way if it is empty.

    Returns:
        Whether there were enough pixels.
    """
    return native.learn_colours(counts, news, table)


def hides(hider: Array32, part: Array32) -> Mask:
    """Which colours are those of what hides a part, by the shares (...,) that they have of both."""
    found: Mask = (hider > _LEAST_HIDER) & (hider > _HIDES * part)
    return found


def tabulate_posteriors(tables: Tables, rule: tuple[float, float], wanted: Mask, posteriors: Image) -> None:
    """Probability that a pixel of a colour lies inside, were both sides as likely, of some parts in some views.

    Args:
        tables: shares of the colours.
        rule: share that a colour never seen has; bound on the logarithm of the odds.
        wanted: (V, P) tables to fill.
        posteriors: (V, P, 4096) output, 254 times the probability; `HIDDEN` for colours of a thing that hides the part.
    """
    native.tabulate_posteriors(tables, rule, wanted, posteriors)
