"""Shifts of the contour: where along its normal does a part's colour end?

Shifting the contour along a line by d leaves the places up to d inside. The posterior of d, flat a priori, has a mean
and a variance: one equation of the pose.
"""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Array32, Integers, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.regions.colours import EVEN, HIDDEN, Picture, colour_at
from tracker.kernels.regions.lines import DEEPEST, NEAR, Looks, Rule, Samples, inside_share, pixels_per_metre
from tracker.kernels.rows import region, sample

_SUPPORT = 3
"""Places on either side of the contour that must look inside and outside."""


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
def _gains_of(slack: float) -> Array:
    """Change (255,) of the energy where a contour moves out over a place, by 254 times its chance to be inside."""
    gains = np.zeros(255)
    for k in range(255):
        gains[k] = np.log(slack * k / 254.0 + (1.0 - slack) * (254 - k) / 254.0) - np.log(
            (1.0 - slack) * k / 254.0 + slack * (254 - k) / 254.0
        )
    return gains


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
def _write_shift(energy: Array, best: int, step: float, shift: Array32) -> None:
    """Mean, px, inverse variance, 1/px^2, and support of the shifts of a line, see `find_shifts`.

    Args:
        energy: (2 reach + 1,) of each shift.
        best: index of the least.
        step: distance of places, px.
        shift: (3,) output.
    """
    n_shifts = len(energy)
    reach = n_shifts // 2
    total = first = second = 0.0
    for d in range(n_shifts):
        weight = np.exp(energy[best] - energy[d])
        total += weight
        first += weight * (d - reach)
        second += weight * (d - reach) ** 2
    mean = first / total
    # A place is a step wide: a twelfth of its square.
    variance = (second / total - mean * mean + 1.0 / 12.0) * step * step
    shift[0] = mean * step
    shift[1] = 1.0 / max(variance, 0.5)
    shift[2] = 1.0 if 0 < best < n_shifts - 1 else 0.3


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
        cameras: (V, 29) from `Rig.packed`.
        wanted: (P,) parts whose samples count.
        rule: how lines are read.
        shifts: (V, M, 3) output: mean shift, px, outwards; its inverse variance, 1/px^2; 1 where the line supports a
            contour there, 0.3 where its best place is the end of the line. All 0 for the others.
    """
    shares, energy = np.zeros(2 * (rule.reach + _SUPPORT)), np.zeros(2 * rule.reach + 1)
    gains = _gains_of(rule.slack)
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
            _write_shift(energy, best, step, shifts[v, m])
