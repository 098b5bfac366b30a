"""The objective of a pose search: poses (B, dof) -> distances (B,), everything else fixed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tracker.arrays import Array
from tracker.body import BodyModel
from tracker.comparison import Comparison
from tracker.equations import Equations
from tracker.estimate import Estimate
from tracker.evidence import Evidence
from tracker.scene import Scene
from tracker.trajectory import History


@dataclass(frozen=True)
class Objective:
    """How badly a pose of one person explains the images: one number, whoever asks for it (paper, figure 1b)."""

    asked: Comparison
    evidence: Evidence
    history: History | None = None
    """What is known of the person from the frames before."""

    collision_px: float = 0.1
    """What a point of a limb inside another one counts, px; see `BodyModel.collisions`."""

    most_collision_px: float = 0.5
    """Most that all of them count, px. What the images say of a limb is 0.2 to 1 px: with 0.5 px a point and no end
    to it, the true pose of crossing limbs cost 1 to 5 px and lost to wrong ones (walking: 63 mm instead of 29)."""

    @property
    def body(self) -> BodyModel:
        """The model whose pose is sought."""
        return self.asked.body

    def __call__(self, poses: Array) -> Array:
        """Distances (B,) px of poses (B, dof); a body that runs through itself is farther off."""
        return self.evidence.distances(self.asked, poses) + self.penalties(poses)

    def penalties(self, poses: Array) -> Array:
        """What poses (B, dof) cost because the body runs through itself (B,), px."""
        penalties: Array = np.minimum(self.collision_px * self.body.collisions(poses), self.most_collision_px)
        return penalties

    def about(self, scene: Scene, person: int) -> Objective:
        """The same question about another person, or with the others elsewhere, in the same frame."""
        asked = Comparison(scene, person, self.asked.synthesis, self.asked.observed)
        return replace(self, asked=asked, history=None)

    def observed_again(self, q: Array) -> Objective:
        """The same question after the images were looked at with a pose (dof,) known; see `Evidence.observe_again`."""
        observed = self.evidence.observe_again(self.asked, q)
        asked = Comparison(self.asked.scene, self.asked.person, self.asked.synthesis, observed)
        return replace(self, asked=asked)

    def equations(self, q: Array, gate_px: float) -> Equations:
        """What a refinement minimizes, linearized at a pose (dof,); see `tracker.evidence.Evidence.equations`."""
        return self.evidence.equations(self.asked, q, gate_px)

    def estimate(self, q: Array, covariance: Array, evaluations: int) -> Estimate:
        """The estimate that a pose (dof,) with covariance (dof, dof) makes; its distance is that of a call."""
        return Estimate(
            q=np.array(q),
            covariance=covariance,
            account=self.evidence.account(self.asked, q),
            penalty_px=float(self.penalties(q[None])[0]),
            evaluations=evaluations,
        )
