"""The pose in which points of a body lie nearest to given ones."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from tracker.bodies.body import BodyModel
from tracker.bodies.keypoints import Meant
from tracker.foundation.arrays import Array

_POINT_M = 0.03
"""Standard deviation of a triangulated keypoint from the joint it means, metres; beyond it errors count linearly."""

_ANGLE_RAD = 1.5
"""Standard deviation of a joint angle from the reference pose, rad: holds twists that points do not show."""

_TRIED = 3
"""Number of starts of the solver, the best of a grid: neighbouring turns lead to the same pose."""

_FREE = 1e3
"""Value in m and rad of an absent limit: the solver needs numbers."""


def fitted_pose(body: BodyModel, marks: Meant, points: Array, weights: Array) -> tuple[Array, Array]:
    """The pose that brings points of a body to given ones, inside the joint limits; robust against single wrong points.

    Args:
        body: owner of the pose.
        marks: N points of the body.
        points: (N, 3) their target positions, metres.
        weights: (N,) confidence in each point, 1 as usual.

    Returns:
        The pose (dof,) and the distances (N,) that remain, metres.
    """
    low, high = body.limits.T
    bounds = np.maximum(low, -_FREE), np.minimum(high, _FREE)
    held, rest = body.rotates & ~np.isin(np.arange(body.dof), body.root.columns), body.rest()

    def placed(q: Array) -> Array:
        return body.points_in_world(q, marks.points, marks.ends)

    def residuals(q: Array) -> Array:
        gaps = (placed(q) - points) * (weights / _POINT_M)[:, None]
        found: Array = np.concatenate([gaps.ravel(), ((q - rest) / _ANGLE_RAD)[held]])
        return found

    def jacobian(q: Array) -> Array:
        motion = body.point_jacobian(q, placed(q), marks.ends) * (weights / _POINT_M)[:, None, None]
        found: Array = np.concatenate([motion.reshape(-1, body.dof), np.eye(body.dof)[held] / _ANGLE_RAD])
        return found

    best, least = body.rest(), np.inf
    for start in _starts(body, marks, points):
        inside = np.clip(start, bounds[0] + 1e-6, bounds[1] - 1e-6)
        found = least_squares(residuals, inside, jacobian, bounds, loss="soft_l1", max_nfev=100)
        if found.cost < least:
            best, least = found.x, found.cost
    return best, np.linalg.norm(placed(best) - points, axis=1)


def _starts(body: BodyModel, marks: Meant, points: Array) -> Array:
    """(S, dof) the reference pose turned and leaned so that they lie near the points, the best of a grid."""
    root = body.root
    turns, leans = np.radians(np.arange(0, 360, 15)), np.radians([-60, 0, 60])
    others = [k for k in root.columns if body.rotates[k] and k != root.turn]
    grids = np.meshgrid(turns, *[leans] * len(others), indexing="ij")
    poses = np.tile(body.rest(), (grids[0].size, 1))
    for k, values in zip((root.turn, *others), grids, strict=True):
        poses[:, k] = values.ravel()
    poses = body.clamped(poses)
    gaps = points - body.points_in_world(poses, marks.points, marks.ends)
    # where most points agree, whatever the limbs do
    shifts = np.median(gaps, axis=1)
    poses[:, root.shifts] += shifts
    misses = np.linalg.norm(gaps - shifts[:, None], axis=2).mean(axis=1)
    best: Array = poses[np.argsort(misses, kind="stable")[:_TRIED]]
    return best
