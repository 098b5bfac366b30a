"""A tapered superquadric fitted to surface points (Metaxas & Terzopoulos 1993, section 3, without dynamics)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from tracker.foundation.arrays import Array
from tracker.foundation.geometry.superquadrics import inside_outside

# Standard deviations of a shape about a plain can along the axis given: what the points do not show stays so.
_LENGTH, _SQUARENESS, _TAPER, _TILT_RAD = 0.1, 0.3, 0.3, 0.2
# A surface point lies so far off a superquadric, as a share of its thickness.
_NOISE = 0.1
# More points than this tell no more of 13 numbers, and take longer.
_MOST_POINTS = 600
_LEAST_POINTS = 12


@dataclass(frozen=True)
class Fitted:
    """A superquadric and its place."""

    shape: Array
    """(7,) packed superquadric, metres."""

    placement: Array
    """(4, 4) of the part's frame."""

    rms_m: float
    """Of the distances of the points along the lines to its middle, metres."""

    bias_m: float
    """Their mean, positive where the points lie outside, metres."""


def fit_superquadric(points: Array, weights: Array, axis: Array, front: Array) -> Fitted:
    """Fits place, extents, squareness and taper by least squares of radial distances.

    The distance of a point x along the line to the middle is ``|x| (1 - F(x)^(-e1/2))`` (exact without a taper).

    Args:
        points: (N, 3) metres.
        weights: (N,) how much of the surface each stands for.
        axis: (3,) about the direction of its z axis.
        front: (3,) about that of x.

    Returns:
        The fit; of fewer than 12 points, a rounded can around them.
    """
    start = _frame(axis, front)
    chosen = np.linspace(0, len(points) - 1, min(len(points), _MOST_POINTS)).astype(int)
    own, share = points[chosen], np.sqrt(weights[chosen] / max(float(weights[chosen].mean()), 1e-12))
    local = own @ start
    low, high = np.percentile(local, [1, 99], axis=0)
    half, centre = np.maximum((high - low) / 2, 0.005), start @ ((low + high) / 2)
    noise = _NOISE * float(half.min())

    def parted(x: Array) -> tuple[Array, Array, Array]:
        rotation = start @ Rotation.from_rotvec(_TILT_RAD * x[3:6]).as_matrix()
        shape = np.concatenate([half * np.exp(x[6:9]), x[9:13]])
        return shape, rotation, centre + noise * x[:3]

    def distances(x: Array) -> Array:
        shape, rotation, middle = parted(x)
        inside = (own - middle) @ rotation
        value = np.maximum(inside_outside(shape, inside), 1e-9)
        gap: Array = np.linalg.norm(inside, axis=1) * (1 - value ** (-shape[3] / 2))
        return gap

    def residuals(x: Array) -> Array:
        prior = [x[3:6], [x[8] / _LENGTH], (x[9:11] - (0.5, 1.0)) / _SQUARENESS, x[11:13] / _TAPER]
        return np.concatenate([share * distances(x) / noise, *prior])

    first = np.array([0, 0, 0, 0, 0, 0, 0, 0, 0, 0.5, 0.9, 0, 0], dtype=np.float64)
    bounds = np.array([[np.inf] * 3 + [3.0] * 3 + [0.7] * 3 + [1.0, 1.0, 0.6, 0.6]] * 2)
    bounds[0] *= -1
    bounds[0, 9:11] = 0.15
    found = first
    if len(own) >= _LEAST_POINTS:
        found = least_squares(residuals, first, bounds=(bounds[0], bounds[1]), loss="soft_l1", max_nfev=60).x
    shape, rotation, middle = parted(found)
    placement = np.eye(4)
    placement[:3, :3], placement[:3, 3] = rotation, middle
    gaps = distances(found)
    total = float((share**2).sum())
    rms, bias = np.sqrt((share**2 * gaps**2).sum() / total), (share**2 * gaps).sum() / total
    return Fitted(shape, placement, float(rms), float(bias))


def _frame(axis: Array, front: Array) -> Array:
    """(3, 3) rotation whose z axis is one direction, and x as near to another as can be."""
    z = axis / np.linalg.norm(axis)
    y = np.cross(z, front)
    if np.linalg.norm(y) < 0.1:
        y = np.cross(z, (0.0, 0.0, 1.0))
    y /= np.linalg.norm(y)
    return np.stack([np.cross(y, z), y, z], axis=1)
