"""A region of an image by level sets: the energy of Rosenhahn et al. 2006, eqs. 1 and 3, and two ways to its minimum.

    E(phi) = - sum H(phi) log p1 / p2 + length sum |grad H(phi)| + shape sum (phi - phi0)^2

phi is positive inside. `descent` is the paper's way, eqs. 2 and 4: gradient descent in a band about the zero level.
`threshold_dynamics` minimizes the same energy over regions, their length measured by how much of a Gaussian flows out
(Esedoglu, Otto: Threshold dynamics for networks with arbitrary surface tensions, 2015): a blur and a threshold a step.
The data then count with the slope of H at the contour, as they do in eq. 4.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.special import erf

from tracker.foundation.arrays import Array, Array32, Image, Mask, frozen

# How likely what a pixel shows is inside and outside of a region: smoothed Parzen densities of colour and texture.
#
# The densities p1 and p2 of Rosenhahn et al. 2006, section 2.1, with the texture channels of section 2.1's end: the
# structure tensor (after Brox, Rousson, Deriche, Weickert, CAIP 2003), whose channels count as independent of the
# colour.

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


_SOFT_PX = 1.0
"""Width of the regularized Heaviside function: half of the step lies within 0.7 px."""

_RIDGE = float(1 / (np.sqrt(2 * np.pi) * _SOFT_PX))
"""Slope of H(phi) at the zero level, 1 / px."""

_STEEP_PX = 6.0 * _SOFT_PX
"""Farther from the zero level H(phi) is 0 or 1 to nine digits."""

_FLAT = 1e-3
"""Slope of H(phi) that keeps its direction defined where there is none."""

_BAND_PX = 4.0
"""Half width of the narrow band: 1e-4 of the step of H lies outside."""

_LATER_STEPS = 5
"""After so many steps phi is made a distance again: slopes of 1 keep the band as wide as it is."""

_MOST_PX = 0.5
"""Farthest that phi changes in a step of the descent, px."""

_LEAST_PX = 1e-3
"""A descent ends where no step larger than this lowers the energy, px."""

_LONGER = 1.5
"""How much longer the next step is tried."""

_BLUR_PX = 2.0
"""Standard deviation of the Gaussian of threshold dynamics; a smaller one gets stuck on the pixels' corners."""

_BLUR_SIZE = 13, 13
"""Three standard deviations to every side: 0.3 % lie beyond."""

_CIRCUMFERENCE = float(np.sqrt(2 * np.pi) / _BLUR_PX)
"""Length of an outline over what flows out of it through a Gaussian of `_BLUR_PX`."""


@dataclass(frozen=True)
class Forces:
    """Forces on a contour."""

    odds: Array32
    """(h, w) log p1 / p2 of every pixel; large where it belongs inside."""

    length: float
    """Weight of the contour's length, odds a px."""

    prior: Array32 | None = None
    """(h, w) phi0, signed distance to the outline of the projected model, px, positive inside; None for none."""

    shape: float = 0.0
    """Weight lambda of the prior, odds a px^2."""


def signed_distance(mask: Mask, reach_px: float = np.inf) -> Array32:
    """(h, w) distance to the outline of a mask, px, positive inside, clamped."""
    inside = mask.astype(np.uint8)
    if not inside.any() or inside.all():
        far = float(min(reach_px, sum(mask.shape)))
        return np.full(mask.shape, far if inside.any() else -far, dtype=np.float32)
    inwards = cv2.distanceTransform(inside, cv2.DIST_L2, 3)
    outwards = cv2.distanceTransform(1 - inside, cv2.DIST_L2, 3)
    # The outline lies half-way between the pixels on both sides.
    distance: Array32 = np.where(mask, inwards - np.float32(0.5), np.float32(0.5) - outwards)
    return np.clip(distance, -reach_px, reach_px) if np.isfinite(reach_px) else distance


def heaviside(phi: Array) -> Array:
    """Regularized step of width `_SOFT_PX`, 0 outside to 1 inside: the error function."""
    step: Array = (phi > 0).astype(np.float64)
    near = np.abs(phi) < _STEEP_PX
    step[near] = 0.5 * (1 + erf(phi[near] / (np.sqrt(2) * _SOFT_PX)))
    return step


def energy(phi: Array, forces: Forces) -> float:
    """The energy of eqs. 1 and 3 on the pixels, up to a constant; differences are forward ones."""
    step = heaviside(phi)
    along, down = _slopes(step)
    length = np.sqrt(along**2 + down**2 + _FLAT**2).sum()
    total = forces.length * length - (step * forces.odds).sum()
    if forces.prior is not None:
        total += forces.shape * ((phi - forces.prior) ** 2).sum()
    return float(total)


def gradient(phi: Array, forces: Forces) -> Array:
    """(h, w) derivative of `energy`: minus the right side of eqs. 2 and 4, exact on the pixels."""
    along, down = _slopes(heaviside(phi))
    slope = np.sqrt(along**2 + down**2 + _FLAT**2)
    along, down = along / slope, down / slope
    curvature = along + down
    curvature[:, 1:] -= along[:, :-1]
    curvature[1:] -= down[:-1]
    near = np.abs(phi) < _STEEP_PX
    found = np.zeros_like(phi)
    ridge = np.exp(-0.5 * (phi[near] / _SOFT_PX) ** 2) / (np.sqrt(2 * np.pi) * _SOFT_PX)
    found[near] = -ridge * (forces.odds[near] + forces.length * curvature[near])
    if forces.prior is not None:
        found += 2 * forces.shape * (phi - forces.prior)
    return found


def _slopes(values: Array) -> tuple[Array, Array]:
    """Forward differences along x and y, 0 at the last pixel."""
    along, down = np.zeros_like(values), np.zeros_like(values)
    along[:, :-1] = values[:, 1:] - values[:, :-1]
    down[:-1] = values[1:] - values[:-1]
    return along, down


def descent(start: Mask, forces: Forces, n_steps: int = 60) -> tuple[Mask, list[tuple[float, float]]]:
    """Gradient descent of eqs. 2 and 4 in a narrow band, with steps that never raise the energy.

    Args:
        start: (h, w) initial region.
        forces: on the contour.
        n_steps: at most.

    Returns:
        (h, w) the region, and the energy before and after each step; phi is made a distance again between some.
    """
    phi = signed_distance(start).astype(np.float64)
    steps: list[tuple[float, float]] = []
    length_px = _MOST_PX
    for n in range(n_steps):
        if n % _LATER_STEPS == _LATER_STEPS - 1:
            phi = signed_distance(phi > 0).astype(np.float64)
        moved, length_px, told = _step(phi, forces, length_px)
        if length_px <= _LEAST_PX:
            break
        phi, length_px = moved, min(_LONGER * length_px, _MOST_PX)
        steps.append(told)
    return phi > 0, steps


def _step(phi: Array, forces: Forces, length_px: float) -> tuple[Array, float, tuple[float, float]]:
    """One step down the gradient in the band, halved until the energy does not rise; its length, 0 if there is none."""
    slope = np.where(np.abs(phi) < _BAND_PX, gradient(phi, forces), 0.0)
    steepest, before = float(np.abs(slope).max()), energy(phi, forces)
    while steepest > 0 and length_px > _LEAST_PX:
        moved: Array = phi - length_px / steepest * slope
        after = energy(moved, forces)
        if after <= before:
            return moved, length_px, (before, after)
        length_px /= 2
    return phi, 0.0, (before, before)


def threshold_dynamics(start: Mask, forces: Forces, n_steps: int = 12) -> Mask:
    """The region of least energy near a start, each step the exact minimum of the energy linearized there.

    A contour rests where eq. 4 has it: what the shape prior draws by, 2 lambda phi0, is what the data do times H'(0).

    Args:
        start: (h, w) region to begin with.
        forces: what its contour is drawn by.
        n_steps: at most; it ends where nothing changes.

    Returns:
        (h, w) the region.
    """
    drive, weight = _drive(forces), np.float32(forces.length * _CIRCUMFERENCE)
    # weight (2 blur - 1) + drive > 0
    level = np.float32(0.5) - drive / (2 * weight) if weight > 0 else -drive
    if weight == 0:
        return np.asarray(level < 0)
    region = start.astype(np.float32)
    for _ in range(n_steps):
        _, grown = cv2.threshold(cv2.subtract(_blurred(region), level), 0, 1, cv2.THRESH_BINARY)
        if cv2.norm(grown, region, cv2.NORM_L1) == 0:
            break
        region = grown
    return region > 0


def _drive(forces: Forces) -> Array32:
    """(h, w) what a pixel is worth inside: odds, and the slope of the prior over that of H at the contour."""
    if forces.prior is None or forces.shape == 0:
        return forces.odds
    drive: Array32 = forces.odds + np.float32(2 * forces.shape / _RIDGE) * forces.prior
    return drive


def _blurred(region: Array32) -> Array32:
    blurred: Array32 = cv2.GaussianBlur(region, _BLUR_SIZE, _BLUR_PX, borderType=cv2.BORDER_REFLECT)
    return blurred
