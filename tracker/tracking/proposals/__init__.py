"""Proposals: methods that propose another pose of a person, one a file, each for a limb that may be elsewhere."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np

from tracker.foundation.arrays import Array
from tracker.tracking.estimate import Estimate
from tracker.tracking.estimation import Estimation
from tracker.tracking.objective import NATS_PER_PX, Objective
from tracker.tracking.verdict import likelier

PROMISING_NATS = 7.0
"""By how much less probable than the present pose a proposed one may be and be refined, nats: by contours alone, and
with the colours of parts. Of 8496 poses that six recordings proposed 6399 were nearer with colours, and of the 273
accepted in the end 264. If a leg lies in the other one, where it has no contour to be wrong, its true place costs 3
nats more by contours. See docs/lab/part_colours.md, docs/lab/one_comparison.md and docs/lab/vain_searches.md."""


class Proposal(Protocol):
    """One method that proposes poses."""

    def __call__(self, objective: Objective, q: Array, limb: str) -> tuple[Array, int]:
        """Other poses, the likeliest first.

        Args:
            objective: judges poses of the frame.
            q: (dof,) the pose at hand, rad and m.
            limb: group of parameters that may be wrong.

        Returns:
            (N, dof) poses inside the joints' limits, to be refined; empty if there are none. And the number of poses
            evaluated for them.
        """
        ...


def promising(objective: Objective, poses: Array, q: Array) -> Array:
    """Those of some poses (N, dof) that a refinement may bring below the present one (dof,), the nearest ones first."""
    distances = NATS_PER_PX * objective(np.concatenate([q[None], poses]))
    order = np.argsort(distances[1:], kind="stable")
    found: Array = poses[order[distances[1:][order] < distances[0] + PROMISING_NATS]]
    return found


def tried(objective: Objective, estimate: Estimate, limb: str, propose: Proposal, refinement: Estimation) -> Estimate:
    """The estimate, or the likeliest proposed pose of a limb, refined."""
    poses, n_evaluations = propose(objective, estimate.q, limb)
    nats = objective.nats(np.concatenate([estimate.q[None], poses]))
    for q in poses[nats[1:] < nats[0] + PROMISING_NATS]:
        estimate = likelier(objective, estimate, refinement.estimate(objective, q[None]))
    return replace(estimate, evaluations=estimate.evaluations + n_evaluations)
