"""Lines across the contour: places along the normal of each of its samples, and what they show.

Each visible contour sample carries a line along its normal (correspondence lines: Tjaden et al., PAMI 2018; Stoiber et
al., ACCV 2020). Every place on it is inside with a probability that the colour tables give.

Places are steps apart, a length on the body, so that lines cover the same stretch of skin and background in every
resolution. Where another part of a body is expected beside the contour, its colours take the place of the background's.
"""

from __future__ import annotations

from typing import NamedTuple

from tracker.arrays import Array, Array32, Image, Integers, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.regions.colours import EVEN, HIDDEN, Picture, Tables
from tracker.kernels.rows.camera import FX, R31, R32, R33, TZ

SPOTS = (4.0, 9.0)
"""Steps outside of the contour at which is asked what part is seen there.

Places up to the middle of the two belong to the first; those inside too, which would show it if the contour moved
inwards.
"""

NEAR = 0.5 * (SPOTS[0] + SPOTS[1])
"""Steps outside up to which the part seen at the first spot counts."""

BACKGROUND = -1
"""No part is seen at a spot."""

DEEPEST = 1.7
"""A line reaches this deep into a part, in smaller half extents: beyond its axis it comes out on the other side."""


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


@compiled
def pixels_per_metre(camera: Array, x: float, y: float, z: float) -> float:
    """Size in the image of a metre across the viewing ray of a world point, px; 0 behind the camera."""
    depth = camera[R31] * x + camera[R32] * y + camera[R33] * z + camera[TZ]
    return float(camera[FX] / depth) if depth > 1e-6 else 0.0


@compiled
def inside_share(looks: Looks, v: int, p: int, beside: int, colour: int, floor: float) -> float:
    """254 times the probability that a pixel of a colour is of part p and not of what is beside it; or `HIDDEN`."""
    if colour < 0:
        return float(EVEN)
    if beside == BACKGROUND or looks.posteriors[v, p, colour] == HIDDEN:
        return float(looks.posteriors[v, p, colour])
    if not looks.known[v, beside]:
        return float(EVEN)
    own = looks.tables.inside[v, p, colour] + floor
    # As far as the posteriors go.
    return 254.0 * min(max(own / (own + looks.tables.inside[v, beside, colour] + floor), 0.018), 0.982)
