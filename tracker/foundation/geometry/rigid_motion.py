"""The rigid motion that brings points nearest to others."""

from __future__ import annotations

import numpy as np

from tracker.foundation.arrays import Array


def rigid_motion(points: Array, targets: Array) -> Array:
    """(4, 4) rotation and shift that bring points nearest to their targets, by least squares and without scale.

    By singular values (Kabsch 1976, Arun et al. 1987); never a reflection. Points on a line leave the turn about it
    open, and one point every turn: what comes back is one of the nearest motions. `Rotation.align_vectors` of scipy
    gives the same to 1e-15; it refuses a single point, warns of a line, and takes twice as long.

    Args:
        points: (N, 3).
        targets: (N, 3). Rows with a NaN in either are left out; one at least must stay.
    """
    known = np.isfinite(points).all(axis=1) & np.isfinite(targets).all(axis=1)
    points, targets = points[known], targets[known]
    middle, there = points.mean(axis=0), targets.mean(axis=0)
    u, _, vt = np.linalg.svd((points - middle).T @ (targets - there))
    proper = np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))])
    motion = np.eye(4)
    motion[:3, :3] = vt.T @ proper @ u.T
    motion[:3, 3] = there - motion[:3, :3] @ middle
    return motion
