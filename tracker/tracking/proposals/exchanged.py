"""Exchanges a limb with its partner on the other side."""

from __future__ import annotations

import numpy as np

from tracker.bodies.limbs import exchanged, mirrored
from tracker.foundation.arrays import Array
from tracker.tracking.objective import Objective
from tracker.tracking.proposals import promising


def propose(objective: Objective, q: Array, limb: str) -> tuple[Array, int]:
    """The pose with the angles of both exchanged, and with their joints; see `tracker.tracking.proposals.Proposal`."""
    body, partner = objective.body, objective.body.partner_of(limb)
    if not partner:
        return np.empty((0, body.dof)), 0
    poses = np.array([place(body, q, limb, partner) for place in (mirrored, exchanged)])
    return promising(objective, poses, q), len(poses)
