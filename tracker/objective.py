"""The objective of a pose search: poses (B, dof) -> distances (B,), everything else fixed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tracker.arrays import Array, Integers
from tracker.body import BodyModel
from tracker.contours import Contours
from tracker.estimate import Estimate
from tracker.observation import Observation
from tracker.scene import Scene
from tracker.similarity import Directed, Evidence, Similarity
from tracker.synthesis import Scoring, Synthesis
from tracker.trajectory import History


@dataclass(frozen=True)
class Objective:
    """Distance between the synthesized and the observed appearance of one person (paper, figure 1b).

    The other persons of the scene stay at their poses: earlier ones at their best, later ones as predicted.
    """

    scene: Scene
    person: int
    synthesis: Synthesis
    similarity: Similarity
    observation: Observation
    history: History | None = None
    """What is known of the person from the frames before."""

    collision_px: float = 0.5
    """What a point of a limb inside another one counts, px; see `BodyModel.collisions`."""

    @property
    def body(self) -> BodyModel:
        """The model whose pose is sought."""
        return self.scene.persons[self.person].body

    @cached_property
    def ends(self) -> Integers:
        """(P,) last pose parameter that moves each part of the scene; -2 for the parts of other persons."""
        found = np.full(len(self.scene.shapes), -2, dtype=np.int64)
        first = self.scene.first_part(self.person)
        found[first : first + len(self.body.parts)] = self.body.part_parameters
        return found

    def __call__(self, poses: Array) -> Array:
        """Distances (B,) px of poses (B, dof); a body that runs through itself is farther off."""
        return self._distances(poses) + self.penalties(poses)

    def penalties(self, poses: Array) -> Array:
        """What poses (B, dof) cost because the body runs through itself (B,), px."""
        return self.collision_px * self.body.collisions(poses)

    def _distances(self, poses: Array) -> Array:
        if isinstance(self.synthesis, Scoring) and isinstance(self.similarity, Directed):
            rule = self.similarity.rule
            directed = self.synthesis.directed_distances(self.scene, self.person, poses, self.observation, *rule)
            return self.similarity.combined(directed)
        return self.similarity.distance(self.contours(poses), self.observation)

    def contours(self, poses: Array) -> Contours:
        """Expected contours of the scene with the person at each of the poses (B, dof)."""
        return self.synthesis.contours(self.scene, self.person, poses)

    def evidence(self, q: Array) -> Evidence:
        """The distance of one pose (dof,) in detail; parts are those of the whole scene."""
        return self.similarity.evidence(self.contours(q[None]), self.observation, len(self.scene.shapes))

    def estimate(self, q: Array, covariance: Array, evaluations: int) -> Estimate:
        """The estimate that a pose (dof,) with covariance (dof, dof) makes, with its evidence."""
        found = self.evidence(q)
        first = self.scene.first_part(self.person)
        own = slice(first, first + len(self.body.parts))
        explained, visible = found.explained[own], found.visible_px[own]
        seen = visible > 0
        share = float((explained[seen] * visible[seen]).sum() / visible[seen].sum()) if seen.any() else 0.0
        return Estimate(
            q=np.array(q),
            covariance=covariance,
            distance_px=found.distance_px,
            per_view_px=found.per_view_px,
            per_part_px=found.per_part_px[own],
            visible_px=visible,
            unexplained_px=np.where(seen, visible * (1 - np.nan_to_num(explained)), 0.0) + found.missed_px[own],
            explained=share,
            evaluations=evaluations,
        )
