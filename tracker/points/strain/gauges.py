"""Strain gauges: each followed point with the points around it, in the plane that touches the surface there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from tracker.foundation.arrays import Array, Integers, Mask

LEAST_POINTS = 5
"""Points of a gauge, its own among them: three fix a plane map, and two more say how well it fits."""

_FLATTEST = 0.1
"""The least spread of a gauge across, as a share of that along: of points in a line nothing is known across."""


class Near(NamedTuple):
    """The points around each of N points, at most K."""

    members: Integers
    """(N, K) their rows; its own where there are fewer."""

    there: Mask
    """(N, K) which of them count."""


def near(positions: Array, reach_m: float, least: int = 1) -> Near:
    """The points around each point that is seen, itself among them.

    Args:
        positions: (N, 3) in the frame of reference, metres; NaN where a point is not seen.
        reach_m: how far they are at most.
        least: where there are fewer, none counts.
    """
    seen = np.flatnonzero(np.isfinite(positions[:, 0]))
    found: list[list[int]] = []
    if len(seen):
        found = cKDTree(positions[seen]).query_ball_point(positions[seen], reach_m).tolist()  # type: ignore[attr-defined]
    width = max((len(rows) for rows in found), default=1)
    members = np.tile(np.arange(len(positions))[:, None], (1, width))
    there = np.zeros(members.shape, dtype=np.bool_)
    for row, rows in zip(seen.tolist(), found, strict=True):
        if len(rows) >= least:
            members[row, : len(rows)], there[row, : len(rows)] = seen[rows], True
    return Near(members, there)


@dataclass(frozen=True)
class Gauges:
    """N gauges of at most K points in a frame of reference."""

    members: Integers
    """(N, K) rows of the points; its own where there are fewer."""

    there: Mask
    """(N, K) which of them count."""

    axes: Array
    """(N, 3, 2) unit vectors along the surface, in the world."""

    places: Array
    """(N, K, 2) of the points along them from the gauge's own, metres."""

    distances: Array
    """(N, K, K) between the points, metres."""


def gauges_of(positions: Array, reach_m: float) -> Gauges:
    """The gauges around all points that are seen; those of too few points have none that count.

    Args:
        positions: (N, 3) in the frame of reference, metres; NaN where a point is not seen.
        reach_m: how far the points of a gauge are from its own at most.
    """
    members, there = near(positions, reach_m, LEAST_POINTS)
    around = np.where(there[..., None], positions[members] - positions[:, None], 0.0)
    middle = around.sum(axis=1, keepdims=True) / np.maximum(there.sum(axis=1), 1)[:, None, None]
    centred = np.where(there[..., None], around - middle, 0.0)
    spreads, directions = np.linalg.eigh(centred.transpose(0, 2, 1) @ centred)
    there &= (spreads[:, 1] > _FLATTEST**2 * spreads[:, 2])[:, None]
    axes = directions[:, :, [2, 1]]
    gaps = np.linalg.norm(around[:, :, None] - around[:, None], axis=-1)
    return Gauges(members, there, axes, around @ axes, gaps)


def spacing_m(positions: Array) -> float:
    """The median distance of a point (N, 3) from the one next to it, metres; NaN for fewer than two."""
    seen = positions[np.isfinite(positions[:, 0])]
    return float(np.median(np.asarray(cKDTree(seen).query(seen, k=2)[0])[:, 1])) if len(seen) > 1 else np.nan
