"""Ranks start poses by edges alone: contours on edges of their direction, and left-over lengths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Array
from tracker.synthesis import side_by_side
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.hypotheses import hypothesis, ranked
from tracker.tracking.initialization import Stages
from tracker.tracking.initialization._floor import shown_share
from tracker.tracking.initialization._stance_search import NOTHING, DirectionImages, Moved
from tracker.tracking.start import Hypothesis

# Poses at a time: bounds the memory.
_BATCH = 256
# Contours for thousands of poses: a third of the samples that estimates are made with.
_ROUGH = CpuSynthesis(step_px=16.0, n_eta=6, n_omega=12)
# Clutter offers edges in one view; a person does in all of them.
_DISAGREEMENT = 0.5
# Two views have to be left.
_VIEWS = 3
# Refined poses with so much less of the best one's score are not ranked.
_BELIEVED = 0.7
# The left-over length counts edges near the pose that began a refinement: it is comparable only from the second time
# on. In a simulation of somebody face down, one refinement ranked the pose turned round first, two did not.
_TIMES = 2


@dataclass(frozen=True)
class Clues:
    """Clues for poses of a person whom no plate shows."""

    edges: DirectionImages
    """Edges of all views."""

    moved: Moved = NOTHING
    """Moved pixels of the person, if known."""

    partly: bool = False
    """Whether one of three views or more may show nothing of the person: then the others may have the score, less a
    share for the missing view. Behind a board in one view a woman's true pose has 0.09 instead of 0.13."""

    def scores(self, scene: Scene, poses: Array) -> Array:
        """(N,) score of contours of poses (N, dof) of a scene's last person on edges; 0 for chance.

        Contours out of sight count as chance; contours that others of the scene hide, and the others' contours, do not
        count. Poses that cover only a part of the moved pixels have that part of the score: of a man who reaches
        forwards before a wall edges alone put the arms elsewhere, and the legs on tiles beside him.
        """
        k = len(scene.persons) - 1
        body, first = scene.persons[k].body, scene.first_part(k)
        batches = [poses[i : i + _BATCH] for i in range(0, len(poses), _BATCH)]
        gains = np.concatenate([self.edges.scores(_ROUGH.contours(scene, k, batch), first) for batch in batches])
        found = shown_share(body, poses, scene.rig) * gains
        covered = np.concatenate([self.moved.covered(body, batch, scene.rig) for batch in batches])
        scores: Array = covered * (_agreed(found) if not self.partly else np.maximum(_agreed(found), _but_one(found)))
        return scores

    def costs(self, scene: Scene, hypotheses: Sequence[Hypothesis]) -> Array:
        """(N,) left-over length of hypotheses, times their distance, over their score.

        Each alone ranks the person turned round first in two of five starts, not in the same ones, and so does this. If
        they disagree the lead is small, and the next frames decide.
        """
        scores = self.scores(scene, np.array([one.q for one in hypotheses]))
        left = np.array([one.left_over * one.distance_px for one in hypotheses])
        costs: Array = left / np.maximum(scores, 1e-3)
        return costs

    def ranked(self, scene: Scene, hypotheses: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
        """Hypotheses that all views support, the one of least cost first.

        The left-over length counts only visible contour: for a body half out of sight that may be next to nothing.
        """
        scores = self.scores(scene, np.array([one.q for one in hypotheses]))
        kept = [hypotheses[int(n)] for n in np.flatnonzero(scores >= _BELIEVED * scores.max())]
        return ranked(scene.persons[-1].body, kept, self.costs(scene, kept))


def _agreed(found: Array) -> Array:
    """(N,) common score of all views, from those of each view (N, V)."""
    agreed: Array = found.mean(axis=1) - _DISAGREEMENT * found.std(axis=1)
    return agreed


def _but_one(found: Array) -> Array:
    """(N,) common score of all views except the worst, from those of each view (N, V)."""
    n_views = found.shape[1]
    if n_views < _VIEWS:
        return _agreed(found)
    rest: Array = _agreed(np.sort(found, axis=1)[:, 1:])
    return np.asarray((n_views - 1) / n_views * rest)


def refined_on_edges(frame: Frame, scene: Scene, stages: Stages, q: Array) -> Hypothesis:
    """The estimate of a pose (dof,) of the scene's last person, from the edges near it."""
    k = len(scene.persons) - 1
    stages.tally.begin()
    for _ in range(_TIMES):
        objective = stages.objective(frame, scene, k, stages.synthesis.contours(scene, k, q[None]))
        estimate = stages.estimation.estimate(objective, q[None])
        q = estimate.q
    return hypothesis(objective.body, estimate)


def all_refined_on_edges(frame: Frame, scene: Scene, stages: Stages, poses: Sequence[Array]) -> list[Hypothesis]:
    """The same for several poses (dof,), side by side."""
    return side_by_side(stages.synthesis, lambda q: refined_on_edges(frame, scene, stages, q), poses)
