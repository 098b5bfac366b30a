"""Lines across the contour: places along the normal of each of its samples, and what they show.

Each visible contour sample carries a line along its normal (correspondence lines: Tjaden et al., PAMI 2018; Stoiber et
al., ACCV 2020). Every place on it is inside with a probability that the colour tables give.

Places are steps apart, a length on the body, so that lines cover the same stretch of skin and background in every
resolution. Where another part of a body is expected beside the contour, its colours take the place of the background's.
"""

from __future__ import annotations

from typing import NamedTuple

from tracker.foundation.arrays import Array, Array32, Image, Integers, Mask
from tracker.kernels.regions.colours import Picture, Tables

SPOTS = (4.0, 9.0)
"""Steps outside of the contour at which is asked what part is seen there.

Places up to the middle of the two belong to the first; those inside too, which would show it if the contour moved
inwards.
"""


class Samples(NamedTuple):
    """Contour samples of one pose, laid out as in `Contours`."""

    positions: Array32
    """(V, M, 5) pixel, unit image normal, contour length, px."""

    points: Array32
    """(V, M, 3) in the world, metres."""

    parts: Integers
    """(V, M)."""

    counts: Integers
    """(V,)."""


class Looks(NamedTuple):
    """What is known of the colours of a scene's parts."""

    tables: Tables

    posteriors: Image
    """(V, P, 4096) see `tabulate_posteriors`."""

    known: Mask
    """(V, P) parts whose colours were learnt in a view."""

    half_extents: Array
    """(P,) smaller half extent of each part across its axis, metres."""


class Rule(NamedTuple):
    """How lines are read."""

    step_m: float
    """Distance of places on the body, metres; never less than a pixel."""

    reach: int
    """Largest shift, steps."""

    slack: float
    """Probability that a place belongs to the other side in spite of its colour."""

    floor: float
    """Share that a colour never seen has."""

    gate_px: float
    """How far the contour may be off, px: lines reach so far, with wider steps."""

    widest: float
    """Most that steps are widened for it, a factor."""


class Lines(NamedTuple):
    """What contours are compared with."""

    picture: Picture
    """Colours seen."""

    looks: Looks
    """Colours known."""

    wanted: Mask
    """(P,) parts whose contours count."""

    rule: Rule
