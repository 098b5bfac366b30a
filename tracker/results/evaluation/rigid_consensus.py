"""The rigid motion that most of two sets of points agree with."""

from __future__ import annotations

import numpy as np

from tracker.foundation.arrays import Array
from tracker.foundation.geometry.motions import rigid_motion

FAR_M = 0.15
"""Beyond it a sample says only that it does not fit; half of an upper arm."""

_N_DRAWS = 300
"""Of three samples each: 1 - 1e-17 that one of them is right though half of the samples are wrong."""

_N_JUDGES = 600
"""Samples by which the draws are ranked."""


def by_triples(mine: Array, other: Array) -> tuple[Array, Array]:
    """Rotation and translation that most samples agree with, of random triples (the same in every call)."""
    rng = np.random.default_rng(0)
    judges = rng.choice(len(mine), min(_N_JUDGES, len(mine)), replace=False)
    best: tuple[float, Array, Array] = np.inf, np.eye(3), np.zeros(3)
    for _ in range(_N_DRAWS):
        chosen = rng.choice(len(mine), 3, replace=False)
        motion = rigid_motion(mine[chosen], other[chosen])
        rotation, translation = motion[:3, :3], motion[:3, 3]
        distance = np.linalg.norm(mine[judges] @ rotation.T + translation - other[judges], axis=1)
        cost = float((np.minimum(distance, FAR_M) ** 2).mean())
        if cost < best[0]:
            best = cost, rotation, translation
    return best[1:]
