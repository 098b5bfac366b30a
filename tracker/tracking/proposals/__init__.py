"""Proposals: ways to think of another pose of a person, one a file, each for a limb that may be elsewhere."""

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
"""How much farther off than the pose at hand a proposed one may be, px, before it is refined: by contours alone, and
with the colours of parts counted. Of 8496 poses that six recordings proposed 6399 were nearer with colours, and of the
273 that were taken in the end 264. The true place of a leg that was put into the other one, where it has no contour to
be wrong, costs 1.05 px more by contours. See docs/lab/part_colours.md, docs/lab/one_comparison.md and
docs/lab/vain_searches.md."""


class Proposal(Protocol):
    """One way to think of a pose."""

    def __call__(self, objective: Objective, q: Array, limb: str) -> tuple[Array, int]:
        """Other poses, the likeliest first.

        Args:
            objective: judges poses of the frame.
            q: (dof,) the pose at hand, rad and m.
            limb: group of parameters that may be wrong.

        Returns:
            (N, dof) poses inside the joints' limits, to be refined; none where the way leads nowhere. And the number of
            poses evaluated to find them.
        """
        ...


def promising(objective: Objective, poses: Array, q: Array) -> Array:
    """Those of some poses (N, dof) that a refinement may bring below the one at hand (dof,), the nearest ones first."""
    distances = objective(np.concatenate([q[None], poses]))
    order = np.argsort(distances[1:], kind="stable")
    found: Array = poses[order[distances[1:][order] < distances[0] + PROMISING_PX]]
    return found


def tried(objective: Objective, estimate: Estimate, limb: str, propose: Proposal, refinement: Estimation) -> Estimate:
    """The estimate, or the likeliest of what is proposed of a limb once that is refined."""
    poses, n_evaluations = propose(objective, estimate.q, limb)
    deciding = objective.deciding_px(np.concatenate([estimate.q[None], poses]))
    for q in poses[deciding[1:] < deciding[0] + PROMISING_PX]:
        estimate = likelier(objective, estimate, refinement.estimate(objective, q[None]))
    return replace(estimate, evaluations=estimate.evaluations + n_evaluations)
