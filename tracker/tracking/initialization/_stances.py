"""Stances: poses without a place, standing, seated, crouching or lying, and the ways in which they may be turned."""

from __future__ import annotations

import warnings
from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array

Stance = Mapping[str, float]
"""Parameter -> degrees; a name without the word of the side means both. The root's angles say how the body lies."""


def posed(body: BodyModel, stance: Stance) -> Array:
    """The reference pose (dof,) with a stance's angles; those of the root may be outside its limits."""
    q = body.rest()
    for name, angle_deg in stance.items():
        q[body.columns(name)] = np.radians(angle_deg)
    root = body.root.columns
    clamped = body.clamped(q)
    clamped[root] = q[root]
    return clamped


def turned(body: BodyModel, q: Array, headings: Array) -> Array:
    """A pose (dof,) turned about the vertical by angles (N,), rad: (N, dof), inside the limits.

    All angles of the root change with the heading of a body that lies.
    """
    root = body.root.columns
    columns = root[body.rotates[root]]
    attitude = Rotation.from_matrix(body.world_from_parameters(q)[root[-1], :3, :3])
    about_vertical = Rotation.from_rotvec(np.outer(headings, [0.0, 0.0, 1.0]))
    poses = np.tile(q, (len(headings), 1))
    axes = np.array([body.parameters[column].axis for column in columns])
    if len(columns) == 3 and np.abs(axes[1] @ axes[[0, 2]].T).max() < 1e-6:
        with warnings.catch_warnings():
            # Where the outer and the inner axis fall together, any share of the angle between them will do.
            warnings.filterwarnings("ignore", message="Gimbal lock")
            poses[:, columns] = (about_vertical * attitude).as_davenport(axes, "intrinsic")
    else:
        poses[:, body.root.turn] += headings
    return body.clamped(poses)


def on_floor(body: BodyModel, poses: Array, places: Array, floor_m: float) -> Array:
    """Poses (N, dof) moved so that their lowest part is on the floor and their landmarks are around places (N, 2)."""
    low, high = _box(body, poses)
    moved = poses.copy()
    moved[:, body.root.shifts[:2]] += places - ((low + high) / 2)[:, :2]
    moved[:, body.root.shifts[2]] += floor_m - _lowest(body, poses)
    return moved


def _box(body: BodyModel, poses: Array) -> tuple[Array, Array]:
    marks = body.landmarks_in_world(poses)
    return marks.min(axis=1), marks.max(axis=1)


def _lowest(body: BodyModel, poses: Array) -> Array:
    """Height (N,) of the lowest end of a part, metres."""
    placed = body.world_from_part(poses)
    ends = placed[..., 2, 3] - np.abs(placed[..., 2, 2]) * body.shapes[:, 2]
    lowest: Array = (ends - body.shapes[:, :2].min(axis=1)).min(axis=1)
    return lowest
