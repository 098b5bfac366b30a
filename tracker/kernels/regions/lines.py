"""Lines across the contour: where along its normal does a part's colour end?

Each visible contour sample carries a line along its normal (correspondence lines: Tjaden et al., PAMI 2018; Stoiber et
al., ACCV 2020). Every place on it is inside with a probability that the colour tables give; shifting the contour along
the line by d leaves the places up to d inside. The posterior of d, flat a priori, has a mean and a variance: one
equation of the pose.

Places are steps apart, a length on the body, so that lines cover the same stretch of skin and background in every
resolution. Where another part of a body is expected beside the contour, its colours take the place of the background's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tracker.arrays import Array, Array32, Image, Integers, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.regions.colours import EVEN, HIDDEN, N_COLOURS, Picture, Tables, colour_at, learn_colours
from tracker.kernels.rows import region, sample
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

_SUPPORT = 3
"""Places on either side of the contour that must look inside and outside."""

DEEPEST = 1.7
"""A line reaches this deep into a part, in smaller half extents: beyond its axis it comes out on the other side."""

_LEARNT_INSIDE, _LEARNT_OUTSIDE = 12, 22
"""Steps inside and outside whose colours are learnt."""


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


@compiled
def _read_line(
    picture: Picture,
    looks: Looks,
    place: tuple[int, int, float, float, float, float],
    beside: tuple[int, int],
    spacing: tuple[float, float, float],
    shares: Array,
) -> None:
    """Probability of being inside, times 254, of places from inside to outside.

    Args:
        picture, looks: colours seen and known.
        place: view, part, pixel and unit image normal of the contour sample.
        beside: parts seen at the `SPOTS`.
        spacing: step, px; how deep the line may go into the part, px; `Rule.floor`.
        shares: (N,) output; the contour is between the two middle places.
    """
    v, p, x, y, nu, nv = place
    step, deep, floor = spacing
    half = len(shares) // 2
    for s in range(len(shares)):
        along = s - half + 0.5
        if along * step < -deep:
            shares[s] = EVEN
            continue
        other = beside[0] if along < NEAR else beside[1]
        colour = colour_at(picture, v, x + nu * along * step, y + nv * along * step)
        share = inside_share(looks, v, p, other, colour, floor)
        shares[s] = share if share < HIDDEN else EVEN


@compiled
def _weigh_shifts(shares: Array, reach: int, gains: Array, energy: Array) -> int:
    """Energy (2 reach + 1,) of each shift of the contour, relative to the first; index of the least."""
    start = len(shares) // 2 - reach
    best = 0
    energy[0] = 0.0
    for d in range(2 * reach):
        energy[d + 1] = energy[d] + gains[int(shares[start + d] + 0.5)]
        if energy[d + 1] < energy[best]:
            best = d + 1
    return best


@compiled
def _supported(shares: Array, contour: int) -> bool:
    """Whether the places beside a contour look inside and outside, on average."""
    inside = outside = 0.0
    for k in range(_SUPPORT):
        inside += shares[contour - 1 - k]
        outside += shares[contour + k]
    return inside > _SUPPORT * 140.0 and outside < _SUPPORT * 133.0


@compiled
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
    """How far the contour has to move along its normal at each sample of one pose.

    Args:
        picture, looks: colours seen and known.
        samples: contour samples; those of weight 0 are left out.
        beside: (V, M, 2) parts seen at the `SPOTS`.
        cameras: (V, 28) from `Rig.packed`.
        wanted: (P,) parts whose samples count.
        rule: how lines are read.
        shifts: (V, M, 3) output: mean shift, px, outwards; its inverse variance, 1/px^2; 1 where the line supports a
            contour there, 0.3 where its best place is the end of the line. All 0 for the others.
    """
    n_shifts = 2 * rule.reach + 1
    shares, energy = np.zeros(2 * (rule.reach + _SUPPORT)), np.zeros(n_shifts)
    gains = np.zeros(255)
    for k in range(255):
        gains[k] = np.log(rule.slack * k / 254.0 + (1.0 - rule.slack) * (254 - k) / 254.0) - np.log(
            (1.0 - rule.slack) * k / 254.0 + rule.slack * (254 - k) / 254.0
        )
    for v in range(len(samples.counts)):
        seen = picture.layout[v, region.WIDTH] > 0
        for m in range(samples.counts[v]):
            shifts[v, m, 0] = shifts[v, m, 1] = shifts[v, m, 2] = 0.0
            p = samples.parts[v, m]
            if not seen or samples.positions[v, m, sample.LENGTH] <= 0.0 or not wanted[p] or not looks.known[v, p]:
                continue
            size = pixels_per_metre(
                cameras[v], samples.points[v, m, 0], samples.points[v, m, 1], samples.points[v, m, 2]
            )
            step = max(size * rule.step_m, 1.0)
            step = min(max(step, rule.gate_px / rule.reach), rule.widest * step)
            position = samples.positions[v, m]
            place = (v, p, position[0], position[1], position[2], position[3])
            spacing = (step, DEEPEST * size * looks.half_extents[p], rule.floor)
            _read_line(picture, looks, place, (beside[v, m, 0], beside[v, m, 1]), spacing, shares)
            best = _weigh_shifts(shares, rule.reach, gains, energy)
            if not _supported(shares, _SUPPORT + best):
                continue
            total = first = second = 0.0
            for d in range(n_shifts):
                weight = np.exp(energy[best] - energy[d])
                total += weight
                first += weight * (d - rule.reach)
                second += weight * (d - rule.reach) ** 2
            mean = first / total
            # A place is a step wide: a twelfth of its square.
            variance = (second / total - mean * mean + 1.0 / 12.0) * step * step
            shifts[v, m, 0] = mean * step
            shifts[v, m, 1] = 1.0 / max(variance, 0.5)
            shifts[v, m, 2] = 1.0 if 0 < best < n_shifts - 1 else 0.3


@compiled
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
        cameras: (V, 28) from `Rig.packed`.
        half_extents: (P,) metres, see `Looks`.
        useful: (V, M) samples to learn from.
        step_m: see `Rule`.
        news: weight of what is seen now.
        posteriors: (V, P, 4096) of the frame before: a line that shows a hider inside teaches how that looks.
        tables: in and out.

    Returns:
        (V, P) tables that changed.
    """
    n_views, n_parts = tables.inside.shape[:2]
    changed = np.zeros((n_views, n_parts), dtype=np.bool_)
    inside, outside = np.zeros(N_COLOURS, dtype=np.int64), np.zeros(N_COLOURS, dtype=np.int64)
    hidden = np.zeros(N_COLOURS, dtype=np.int64)
    for v in range(n_views):
        hidden[:] = 0
        for p in range(n_parts):
            inside[:] = 0
            outside[:] = 0
            n = 0
            for m in range(samples.counts[v]):
                if samples.parts[v, m] == p and useful[v, m]:
                    _count_line(
                        picture,
                        samples,
                        beside,
                        cameras,
                        half_extents,
                        step_m,
                        v,
                        m,
                        posteriors,
                        inside,
                        outside,
                        hidden,
                    )
                    n += 1
            if n > 0:
                changed[v, p] = learn_colours(inside, news, tables.inside[v, p])
                changed[v, p] |= learn_colours(outside, news, tables.outside[v, p])
        if learn_colours(hidden, news, tables.hiders[v]):
            changed[v] = True
    return changed


@compiled
def _count_line(
    picture: Picture,
    samples: Samples,
    beside: Integers,
    cameras: Array,
    half_extents: Array,
    step_m: float,
    v: int,
    m: int,
    posteriors: Image,
    inside: Integers,
    outside: Integers,
    hidden: Integers,
) -> None:
    """Counts the colours on both sides of one sample, or those inside as the hider's where most of them are."""
    x, y, nu, nv = (
        samples.positions[v, m, 0],
        samples.positions[v, m, 1],
        samples.positions[v, m, 2],
        samples.positions[v, m, 3],
    )
    p = samples.parts[v, m]
    size = pixels_per_metre(cameras[v], samples.points[v, m, 0], samples.points[v, m, 1], samples.points[v, m, 2])
    step = max(size * step_m, 1.0)
    deep = DEEPEST * size * half_extents[p]
    n_inside = n_hidden = 0
    for k in range(1, _LEARNT_INSIDE + 1):
        if k * step > deep:
            break
        colour = colour_at(picture, v, x - nu * k * step, y - nv * k * step)
        if colour >= 0:
            n_inside += 1
            n_hidden += 1 if posteriors[v, p, colour] == HIDDEN else 0
    covered = 2 * n_hidden > n_inside
    for k in range(1, _LEARNT_INSIDE + 1):
        if k * step > deep:
            break
        colour = colour_at(picture, v, x - nu * k * step, y - nv * k * step)
        if colour >= 0 and covered:
            hidden[colour] += 1
        elif colour >= 0 and posteriors[v, p, colour] != HIDDEN:
            inside[colour] += 1
    if covered:
        return
    for k in range(2, _LEARNT_OUTSIDE + 1):
        near = k < NEAR
        if (beside[v, m, 0] if near else beside[v, m, 1]) != BACKGROUND:
            continue
        colour = colour_at(picture, v, x + nu * k * step, y + nv * k * step)
        if colour >= 0:
            outside[colour] += 1
