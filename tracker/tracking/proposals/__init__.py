"""Proposals: methods that propose another pose of a person, one a file, each for a limb that may be elsewhere."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np

from tracker.foundation.arrays import Array
from tracker.tracking.estimate import Estimate
from tracker.tracking.estimation import Estimation
from tracker.tracking.objective import Objective
from tracker.tracking.verdict import likelier

PROMISING_PX = 2.5
"""Largest excess of a proposed pose's distance over the present one's before it is refined, px: by contours alone, and
with the colours of parts. Of 8496 poses that six recordings proposed 6399 were nearer with colours, and of the 273
accepted in the end 264. If a leg lies in the other one, where it has no contour to be wrong, its true place costs 1.05
px more by contours. See docs/lab/part_colours.md, docs/lab/one_comparison.md and docs/lab/vain_searches.md."""


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
    distances = objective(np.concatenate([q[None], poses]))
    order = np.argsort(distances[1:], kind="stable")
    found: Array = poses[order[distances[1:][order] < distances[0] + PROMISING_PX]]
    return found


def tried(objective: Objective, estimate: Estimate, limb: str, propose: Proposal, refinement: Estimation) -> Estimate:
    """The estimate, or the likeliest proposed pose of a limb, refined."""
    poses, n_evaluations = propose(objective, estimate.q, limb)
    deciding = objective.deciding_px(np.concatenate([estimate.q[None], poses]))
    for q in poses[deciding[1:] < deciding[0] + PROMISING_PX]:
        estimate = likelier(objective, estimate, refinement.estimate(objective, q[None]))
    return replace(estimate, evaluations=estimate.evaluations + n_evaluations)
