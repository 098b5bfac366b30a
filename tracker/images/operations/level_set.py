"""A region of an image by level sets: the energy of Rosenhahn et al. 2006, eqs. 1 and 3, and two ways to its minimum.

    E(phi) = - sum H(phi) log p1 / p2 + length sum |grad H(phi)| + shape sum (phi - phi0)^2

phi is positive inside. `descent` is the paper's way, eqs. 2 and 4: gradient descent in a band about the zero level.
`threshold_dynamics` minimizes the same energy over regions, their length measured by how much of a Gaussian flows out
(Esedoglu, Otto: Threshold dynamics for networks with arbitrary surface tensions, 2015): a blur and a threshold a step.
The data then count with the slope of H at the contour, as they do in eq. 4.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.special import erf

from tracker.foundation.arrays import Array, Array32, Mask

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
    """What a contour is drawn by."""

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
        start: (h, w) where the contour begins.
        forces: what it is drawn by.
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


def region_energy(region: Mask, forces: Forces) -> float:
    """What `threshold_dynamics` minimizes: the energy with the length of the outline as a Gaussian measures it."""
    inside = region.astype(np.float32)
    flown = ((1 - inside) * _blurred(inside)).sum(dtype=np.float64)
    return float(forces.length * _CIRCUMFERENCE * flown - (inside * _drive(forces)).sum(dtype=np.float64))


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
