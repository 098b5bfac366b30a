"""The rigid motion between two sets of points: of all of them, and of those that agree."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array

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
        rotation, translation = rigid_motion(mine[chosen], other[chosen])
        distance = np.linalg.norm(mine[judges] @ rotation.T + translation - other[judges], axis=1)
        cost = float((np.minimum(distance, FAR_M) ** 2).mean())
        if cost < best[0]:
            best = cost, rotation, translation
    return best[1:]


def rigid_motion(points: Array, target: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,) that bring points (N, 3) nearest to a target (N, 3) (Kabsch, 1976)."""
    middle, there = points.mean(axis=0), target.mean(axis=0)
    u, _, vt = np.linalg.svd((points - middle).T @ (target - there))
    upright = np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))])
    rotation: Array = vt.T @ upright @ u.T
    return rotation, there - rotation @ middle
