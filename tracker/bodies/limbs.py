"""Puts limbs elsewhere: exchanged with the other side's, turned round, taken from another pose, or scattered."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.geometry import halton

# A bound of the Gauss-Newton steps.
_STEPS = 12
# Joints farther apart than this, in extents of the body at rest, are not in one place: 14 cm of a person.
_APART = 0.08
# Damping of the inverse kinematics, in the units of its normal equations, m^2: a twist that no joint shows stays.
_DAMPING = 1e-4

SMALL_M = 0.8
"""Smaller bodies are smaller than a toddler, metres."""


def apart_m(body: BodyModel) -> float:
    """Least distance between two places of a joint, metres."""
    return _APART * float(body.extents_m.max())


def smallness(body: BodyModel) -> float:
    """Factor of lengths that are set for persons: 1, or for a body below 0.8 m its share of that."""
    extent_m = float(body.extents_m.max())
    return min(extent_m / SMALL_M, 1.0) if extent_m > 0 else 1.0


def are_apart(
    body: BodyModel, poses: Array, other: Array, marks: Mask | slice = slice(None), share: float = 1.0
) -> Mask:
    """Whether joints are elsewhere in poses than in another one.

    Args:
        body: the model.
        poses: (*B, dof) rad and m.
        other: (dof,) pose to compare with.
        marks: (L,) joints that count.
        share: of `apart_m`, from which on they are elsewhere.

    Returns:
        (*B,) whether any of the joints is.
    """
    ways = body.landmarks_in_world(poses)[..., marks, :] - body.landmarks_in_world(other)[marks]
    apart: Mask = np.linalg.norm(ways, axis=-1).max(axis=-1, initial=0.0) > share * apart_m(body)
    return apart


def mirrored(body: BodyModel, q: Array, one: str, other: str) -> Array:
    """The pose (dof,) with the angles of two groups exchanged: limbs that were in symmetric places change places."""
    pose: Array = q.copy()
    pose[body.group(one)], pose[body.group(other)] = q[body.group(other)], q[body.group(one)]
    return body.clamped(pose)


def exchanged(body: BodyModel, q: Array, one: str, other: str) -> Array:
    """The pose (dof,) in which the joints of two limbs are at each other's places, as near as possible.

    Legs that cross stay crossed when their angles are exchanged; here the knee goes to the other knee in the world.

    Args:
        body: the model.
        q: (dof,) rad and m.
        one, other: groups of mirrored limbs, `left_leg` and `right_leg`.
    """
    places = _other_sides(body)
    paired = places != np.arange(len(places))
    marks = np.flatnonzero((body.landmarks_of(one) | body.landmarks_of(other)) & paired)
    columns = np.concatenate([body.group(one), body.group(other)])
    return reaching(body, mirrored(body, q, one, other), columns, marks, body.landmarks_in_world(q)[places[marks]])


def turned_round(body: BodyModel, q: Array) -> Array:
    """The pose (dof,) that faces the other way: its silhouettes are much the same.

    If bodies turn about the length of the trunk, joints go to the places of the other side's, as near as possible. With
    angles exchanged alone, who bends forwards bends backwards then: a head was 0.4 m off, and the pose left 0.55 over
    once refined.
    """
    flipped, alike = _facing_back(body, q), _alike_from_behind(body)
    if 2 * alike.sum() <= len(alike):
        return flipped
    targets = body.landmarks_in_world(q)[_other_sides(body)]
    limbs = [(body.group(limb), body.landmarks_of(limb)) for limb in body.limbs]
    trunk = np.setdiff1d(np.arange(body.dof), np.concatenate([body.carrying, *(columns for columns, _ in limbs)]))
    for columns, marks in ((trunk, ~np.any([marks for _, marks in limbs], axis=0)), *limbs):
        some = np.flatnonzero(marks & alike)
        if not len(columns) or not len(some):
            continue  # the paper's trunk is one piece
        reached = reaching(body, flipped.copy(), columns, some, targets[some])
        gaps = body.landmarks_in_world(np.array([flipped, reached]))[:, some] - targets[some]
        before_m, after_m = np.linalg.norm(gaps, axis=2).sum(axis=1)
        flipped = reached if after_m < before_m else flipped
    return flipped


def _facing_back(body: BodyModel, q: Array) -> Array:
    """The pose (dof,) that faces the other way, with the angles of left and right exchanged."""
    flipped, turn = q.copy(), body.index(body.start.turn)
    flipped[turn] += np.pi if q[turn] <= 0 else -np.pi
    for group in body.limbs:
        flipped[body.group(group)] = q[body.group(body.mirror.of(group))]
    return body.clamped(flipped)


def _alike_from_behind(body: BodyModel) -> Mask:
    """(L,) joints at the places of the other side's once the body is turned round at rest.

    Of persons all but toes are, which would draw legs after them; of animals hardly one.
    """
    rest, back = body.landmarks_in_world(np.array([body.rest(), _facing_back(body, body.rest())]))
    alike: Mask = np.linalg.norm(back - rest[_other_sides(body)], axis=1) < apart_m(body)
    return alike


def _other_sides(body: BodyModel) -> Integers:
    """(L,) position of each landmark's mirrored one; its own if it has none."""
    names = body.landmark_names
    others = (body.mirror.of(name) for name in names)
    pairs = zip(names, others, strict=True)
    return np.array([names.index(other if other in names else name) for name, other in pairs], dtype=np.int64)


def taken_over(body: BodyModel, q: Array, other: Array, group: str) -> Array:
    """The pose (dof,) in which a limb's joints are at their places in another pose (dof,), as near as possible."""
    pose, columns = q.copy(), body.group(group)
    pose[columns] = other[columns]
    marks = np.flatnonzero(body.landmarks_of(group))
    return reaching(body, body.clamped(pose), columns, marks, body.landmarks_in_world(other)[marks])


def scattered(body: BodyModel, centres: Array, group: str, n: int, spread: tuple[float, float]) -> Array:
    """(n, dof) poses with a limb's parameters normally distributed, inside the limits; the same ones every time.

    Args:
        body: the model.
        centres: (C, dof) poses around which they lie, equally many around each; other parameters are the first one's.
        group: the limb's parameters.
        n: number of poses.
        spread: standard deviations of angles, rad, and of translations, m.
    """
    columns = body.group(group)
    sigma = np.where(body.rotates[columns], *spread)
    poses = np.tile(centres[0], (n, 1))
    # the first of Halton's points is the origin, where the normal distribution has no value
    offsets = sigma * ndtri(halton(n + 1, len(columns))[1:])
    # not in turn: Halton's points of even and of odd numbers lie on different sides
    poses[:, columns] = centres[np.arange(n) * len(centres) // n][:, columns] + offsets
    return body.clamped(poses)


def reaching(body: BodyModel, pose: Array, columns: Integers, marks: Integers, targets: Array) -> Array:
    """The pose (dof,) whose landmarks reach for points with some of its parameters, inside the limits.

    Args:
        body: the model.
        pose: (dof,) rad and m, where they begin; changed.
        columns: the parameters that may move.
        marks: (M,) numbers of the landmarks.
        targets: (M, 3) their targets, metres.
    """
    ends = np.array([body.landmarks[mark].parameter for mark in marks], dtype=np.int64)
    for _ in range(_STEPS):
        points = body.landmarks_in_world(pose)[marks]
        jacobian = body.point_jacobian(pose, points, ends)[:, :, columns].reshape(-1, len(columns))
        normal = jacobian.T @ jacobian + _DAMPING * np.eye(len(columns))
        pose[columns] -= np.linalg.solve(normal, jacobian.T @ (points - targets).ravel())
        pose = body.clamped(pose)
    return pose
