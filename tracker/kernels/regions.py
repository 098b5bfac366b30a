"""Colours beside contours, for the evidence of regions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Image, Integers, Mask, Numbers16

# Colours inside and outside of body parts: pixels as colour numbers, and tables of how often each colour occurs.
#
# A colour is one of 16 x 16 x 16 bins of a picture's three channels: lightness, chroma and texture, see
# `images.operations.appearance`. Tables are kept per view and part: one table for a whole person is two to four times
# worse, and no two cameras see the same colours.

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


# Lines across the contour: places along the normal of each of its samples, and what they show.
#
# Each visible contour sample carries a line along its normal (correspondence lines: Tjaden et al., PAMI 2018; Stoiber
# et al., ACCV 2020). Every place on it is inside with a probability that the colour tables give.
#
# Places are steps apart, a length on the body, so that lines cover the same stretch of skin and background in every
# resolution. Where another part of a body is expected beside the contour, its colours take the place of the
# background's.

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
    """Knowledge of the colours of a scene's parts."""

    tables: Tables

    posteriors: Image
    """(V, P, 4096) see `tabulate_posteriors`."""

    known: Mask
    """(V, P) parts whose colours were learnt in a view."""

    half_extents: Array
    """(P,) smaller half extent of each part across its axis, metres."""


class Rule(NamedTuple):
    """Sampling of lines."""

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
    """Data for the comparison of contours."""

    picture: Picture
    """Colours seen."""

    looks: Looks
    """Colours known."""

    wanted: Mask
    """(P,) parts whose contours count."""

    rule: Rule


def parts_beside(
    placements: Array,
    shapes: Array,
    bounds: Array,
    cameras: Array,
    positions: Array32,
    points: Array32,
    parts: Integers,
    counts: Integers,
    step_m: float,
    found: Integers,
) -> None:
    """The part seen at the `SPOTS` outside of each contour sample of many poses.

    Args:
        placements: (B, P, 4, 4) world_from_part, metres.
        shapes: (P, 7) packed superquadrics.
        bounds: (3, P) of the surfaces, see `tracker.kernels.descent.Tracing`.
        cameras: (V, 29) from `Rig.packed`.
        positions, points, parts, counts: of `Contours`.
        step_m: see `Rule`.
        found: (B, V, M, 2) output, -1 where no other part is seen.
    """
    samples = positions, points, parts, counts
    native.parts_beside(placements, shapes, bounds, cameras, *samples, step_m, found)


def score_lines(
    lines: Lines,
    positions: Array32,
    points: Array32,
    parts: Integers,
    counts: Integers,
    beside: Integers,
    cameras: Array,
    misfits: Array,
) -> None:
    """Length beside the contours of many poses on the wrong side of them.

    Args:
        lines: what they are compared with.
        positions, points, parts, counts: of `Contours`, for B poses.
        beside: (B, V, M, 2) parts seen at the `SPOTS`.
        cameras: (V, 29) from `Rig.packed`.
        misfits: (B, V, P, 3) output: contour compared, px; times how much of the line lies on the wrong side, px;
            contour whose lines show the part inside and not outside, px.
    """
    native.score_lines(lines, positions, points, parts, counts, beside, cameras, misfits)


# Poses synthesized and compared with the colours of the images in one go: no contour is written to memory.
#
# In a decomposed search most parts of the body stand still. They are traced, and their lines read, once for all poses;
# of each pose only the moving parts are, and it is asked which lines of the others they cover or lie beside.


def score_regions(
    placements: Array,
    shapes: Array,
    grids: Array32,
    planes: Array32,
    layout: tuple[int, int],
    bounds: Array,
    cameras: Array,
    sizes: Array,
    spacing: tuple[float, float],
    lines: Lines,
) -> Array:
    """Misfits of many poses; the twin is `trace_contours`, `parts_beside` and `score_lines`.

    Args:
        placements, shapes, grids, planes, layout, bounds, cameras, sizes, spacing: see `trace_contours`.
        lines: what they are compared with.

    Returns:
        (B, V, P, 3) see `score_lines`.
    """
    misfits = np.zeros((len(placements), len(cameras), len(shapes), 3))
    body = shapes, grids, planes, layout, bounds
    native.score_regions(placements, *body, cameras, sizes, spacing, lines, misfits)
    return misfits


# Shifts of the contour: where along its normal does a part's colour end?
#
# Shifting the contour along a line by d leaves the places up to d inside. The posterior of d, flat a priori, has a mean
# and a variance: one equation of the pose.


def find_shifts(
    picture: Picture,
    looks: Looks,
    samples: Samples,
    beside: Integers,
    cameras: Array,
    wanted: Mask,
    rule: Rule,
    shifts: Array32,
) -> None:
    """Shift of the contour along its normal at each sample of one pose.

    Args:
        picture, looks: colours seen and known.
        samples: contour samples; those of weight 0 are left out.
        beside: (V, M, 2) parts seen at the `SPOTS`.
        cameras: (V, 29) from `Rig.packed`.
        wanted: (P,) parts whose samples count.
        rule: how lines are read.
        shifts: (V, M, 3) output: mean shift, px, outwards; its inverse variance, 1/px^2; 1 where the line supports a
            contour there, 0.3 where its best place is the end of the line. All 0 for the others.
    """
    native.find_shifts(picture, looks, samples, beside, cameras, wanted, rule, shifts)


def shift_equations(
    shifts: Array32,
    samples: Samples,
    ends: Integers,
    cameras: Array,
    twists: Array,
    moves: Mask,
    px_per_observation: float,
) -> tuple[Array, Array, float, float]:
    """Normal equations that move every sample along its normal by its shift.

    By wrenches, see native/body/wrenches.hpp; g is the derivative of the projection along the image normal.

    Args:
        shifts: (V, M, 3) from `find_shifts`; a line counts by its inverse variance, px^-2, and its support.
        samples: contour samples.
        ends: (P,) last parameter that moves each part, -1 for the world; -2 for parts that do not count.
        cameras: (V, 29) from `Rig.packed`.
        twists: (dof, 6) spatial twists of the parameters.
        moves: (dof, dof + 1) from `BodyModel.moves`.
        px_per_observation: contour length that counts as one observation, px.

    Returns:
        J^T W J (dof, dof), J^T W r (dof,), sum of w r^2 and sum of w.
    """
    matrix, vector = np.empty((len(twists), len(twists))), np.empty(len(twists))
    sums = native.shift_equations(shifts, samples, ends, cameras, twists, moves, px_per_observation, matrix, vector)
    return matrix, vector, *sums


# Colours learnt along the lines across contours: on both sides of them, and of what hides them.


def learn_lines(
    picture: Picture,
    samples: Samples,
    beside: Integers,
    cameras: Array,
    half_extents: Array,
    useful: Mask,
    step_m: float,
    news: float,
    posteriors: Image,
    tables: Tables,
) -> Mask:
    """Learns the colours on both sides of contours, and those of what hides them.

    Args:
        picture: colours seen.
        samples: contour samples of one pose.
        beside: (V, M, 2) parts seen at the `SPOTS`; a part's pixels are not the background.
        cameras: (V, 29) from `Rig.packed`.
        half_extents: (P,) metres, see `Looks`.
        useful: (V, M) samples to learn from.
        step_m: see `Rule`.
        news: weight of what is seen now.
        posteriors: (V, P, 4096) of the frame before: a line that shows a hider inside teaches how that looks.
        tables: in and out.

    Returns:
        (V, P) tables that changed.
    """
    changed = np.zeros(tables.inside.shape[:2], dtype=np.bool_)
    counted, rule = (beside, cameras, half_extents, useful), (step_m, news)
    native.learn_lines(picture, samples, *counted, *rule, posteriors, tables, changed)
    return changed


def longest_lines(samples: Samples, cameras: Array, step_m: float, longest_px: Array) -> None:
    """How far from a view's contour colours are learnt, px, with the pixel that the last step is rounded to.

    Args:
        samples: contour samples of one pose.
        cameras: (V, 29) from `Rig.packed`.
        step_m: see `Rule`.
        longest_px: (V,) output.
    """
    native.longest_lines(samples, cameras, step_m, longest_px)
