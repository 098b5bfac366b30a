"""Velocities and accelerations of followed points, with their precision."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.foundation.arrays import Array, Mask
from tracker.points.trajectories import PointTrajectories

# A parabola through four has one redundant observation.
_LEAST_FRAMES = 4


REACH_FRAMES = 2
"""Frames before and after that take part in a fit."""


@dataclass(frozen=True)
class Motion:
    """How N points move in T frames; units are those of the positions, a second."""

    velocities: Array
    """(T, N, D); NaN where fewer than four frames around show the point."""

    accelerations: Array
    """(T, N, D)"""

    velocity_sigmas: Array
    """(T, N, D) from the sigmas of the positions, taken as independent: key patches are shared, so it is less."""

    acceleration_sigmas: Array
    """(T, N, D)"""


def motion_of(trajectories: PointTrajectories, reach: int = REACH_FRAMES) -> Motion:
    """Fits a parabola to the frames around each one.

    Args:
        trajectories: N points in T frames.
        reach: frames before and after that take part, where the point is seen in them without a gap; at the ends of
            the sequence more of the other side.

    Returns:
        First and second derivatives of the parabolas at their middle.
    """
    positions, times = trajectories.positions, trajectories.times
    n_frames = len(times)
    known = trajectories.seen, trajectories.sigmas**2
    parts = [_fitted(trajectories, *known, t, reach) for t in range(n_frames)]
    first, second, first_sigma, second_sigma = (np.stack([part[k] for part in parts]) for k in range(4))
    assert first.shape == positions.shape
    return Motion(first, second, first_sigma, second_sigma)


def _fitted(
    trajectories: PointTrajectories, all_seen: Mask, variances: Array, t: int, reach: int
) -> tuple[Array, Array, Array, Array]:
    """Velocities, accelerations and their sigmas (N, D) in one frame."""
    n_frames = len(trajectories.times)
    first = min(max(0, t - reach), max(0, n_frames - 2 * reach - 1))
    around = np.arange(first, min(n_frames, first + 2 * reach + 1))
    seen = all_seen[around]
    # A gap ends the window: what lies behind it may be another place of a movement that was not seen.
    middle = int(np.flatnonzero(around == t)[0])
    for k in range(middle + 1, len(around)):
        seen[k] &= seen[k - 1]
    for k in range(middle - 1, -1, -1):
        seen[k] &= seen[k + 1]
    elapsed = trajectories.times[around] - trajectories.times[t]
    scale = max(float(np.abs(elapsed).max(initial=0.0)), 1e-9)
    design = np.stack([np.ones_like(elapsed), elapsed / scale, (elapsed / scale) ** 2], axis=1)
    weight = seen.astype(np.float64)
    normal = np.einsum("ki,kj,kn->nij", design, design, weight)
    enough = weight.sum(axis=0) >= _LEAST_FRAMES
    normal[~enough] = np.eye(3)
    inverse = np.linalg.inv(normal)
    values = np.where(seen[..., None], trajectories.positions[around], 0.0)
    spread = np.where(seen[..., None], variances[around], 0.0)
    gains = np.einsum("nij,kj,kn->kni", inverse, design, weight)
    factors = np.array([1.0, 1 / scale, 2 / scale**2])
    found = np.einsum("kni,knd->ind", gains, values) * factors[:, None, None]
    sigmas = np.sqrt(np.einsum("kni,knd->ind", gains**2, spread)) * factors[:, None, None]
    found[:, ~enough], sigmas[:, ~enough] = np.nan, np.nan
    return found[1], found[2], sigmas[1], sigmas[2]
