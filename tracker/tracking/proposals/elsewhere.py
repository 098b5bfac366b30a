"""A limb may be anywhere that its joints allow: contours, and the colours of parts, decide."""

from __future__ import annotations

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.limbs import apart_m, are_apart
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.geometry import halton
from tracker.tracking.objective import Objective
from tracker.tracking.proposals import promising

# Number of places of a limb over all that its joints allow; of the nearest ones that are compared by colours, and of
# those that are refined. See docs/lab/part_colours.md.
_TRIED, _LOOKED_AT, _REFINED = 600, 24, 6
# Limits that leave a joint less than this leave its limb about where it is.
_WIDE_RAD = np.radians(89.0)


def propose(objective: Objective, q: Array, limb: str) -> tuple[Array, int]:
    """Poses with the limb in other places; see `tracker.tracking.proposals.Proposal`."""
    body = objective.body
    poses = _over_all_places(body, q, limb)
    poses = poses[are_apart(body, poses, q, body.landmarks_of(limb))]
    different = _different(body, promising(objective.by_parts(), poses, q), limb)
    likeliest = np.argsort(objective.nats(different), kind="stable")[:_REFINED]
    return different[likeliest], len(poses) + len(different)


def _over_all_places(body: BodyModel, q: Array, group: str) -> Array:
    """(N, dof) poses with a limb everywhere its wide joints allow; narrow ones and its end are as usual."""
    columns = body.group(group)
    wide = columns[_leads_far(body, columns, group)]
    if not len(wide):
        return np.empty((0, body.dof))
    low, high = body.limits[wide].T
    poses = np.tile(q, (_TRIED, 1))
    poses[:, columns] = body.rest()[columns]
    poses[:, wide] = low + halton(_TRIED, len(wide)) * (high - low)
    return poses


def _leads_far(body: BodyModel, columns: Integers, group: str) -> Mask:
    """(N,) whether parameters of a limb turn far, and move more than its last part alone."""
    parts = np.flatnonzero(body.parts_of(group))
    moves = body.moves[np.ix_(columns, body.part_parameters[parts])]
    wide = np.ptp(body.limits[columns], axis=1) > _WIDE_RAD
    far: Mask = wide & ((moves.sum(axis=1) > 1) | (len(parts) == 1))
    return far


def _different(body: BodyModel, poses: Array, group: str) -> Array:
    """The first (n, dof) of some poses (N, dof) with limbs in different places."""
    joints = body.landmarks_in_world(poses)[:, body.landmarks_of(group)]
    left = np.arange(len(poses))
    chosen: list[int] = []
    while len(left) and len(chosen) < _LOOKED_AT:
        chosen.append(int(left[0]))
        gaps = np.linalg.norm(joints[left] - joints[left[0]], axis=2).max(axis=1, initial=0.0)
        left = left[gaps > apart_m(body)]
    different: Array = poses[chosen]
    return different
