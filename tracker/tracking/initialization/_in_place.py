"""Starts of bodies that stay in place, an arm of a robot or a pendulum: only their joints are searched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Array
from tracker.foundation.geometry import halton
from tracker.foundation.progress import Tally
from tracker.tracking.estimation.best_first import BestFirstEstimation
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.hypotheses import different, finalists, hypothesis, ranked, with_held
from tracker.tracking.initialization import Stages
from tracker.tracking.initialization._person_sized import person_sized
from tracker.tracking.start import Hypothesis, Start

# Poses that are tried, so many at a time, how many are refined, and how far apart these are, in extents of the body.
_TRIED, _BATCH, _REFINED, _APART = 3000, 128, 6, 0.05
_FINALISTS = 3


class InPlace:
    """Searches for bodies that stay in place; see `KinematicTree.stays`."""

    fine = BestFirstEstimation(range_deg=60.0, step_deg=20.0, range_m=0.1, step_m=0.05, halvings=2, patience=3)
    refinement = TwistIcpEstimation()

    @person_sized
    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        """Poses of the persons of a scene that stay and are not held; the others' poses as they are."""
        rankings: list[tuple[Hypothesis, ...]] = [()] * len(scene.persons)
        held = stages.held
        for k in staying(scene):
            if k not in stages.held:
                rankings[k] = self._search(frame, with_held(scene, k, held), stages)
                scene, held = scene.with_pose(k, rankings[k][0].q), (*held, k)
        return Start(tuple(person.q for person in scene.persons), (), tuple(rankings))

    def _search(self, frame: Frame, scene: Scene, stages: Stages) -> tuple[Hypothesis, ...]:
        """Hypotheses of the scene's last person, the best first."""
        body, k = scene.persons[-1].body, len(scene.persons) - 1
        poses = _everywhere(body)
        stages.progress(f"start: {len(poses)} poses of {scene.persons[-1].name}, where its model stands")
        objective = stages.objective(frame, scene, k)
        distances = np.concatenate([objective(poses[i : i + _BATCH]) for i in range(0, len(poses), _BATCH)])
        apart_m = _APART * float(body.extents_m.max())
        tally, refined = Tally(stages.progress, "start: pose", _REFINED), []
        for q in different(body, poses[np.argsort(distances, kind="stable")], _REFINED, apart_m):
            tally.begin()
            searched = self.fine.estimate(objective, q[None])
            refined.append(hypothesis(body, self.refinement.estimate(objective, searched.q[None])))
        best = ranked(body, refined)[:_FINALISTS]
        settled = [hypothesis(body, stages.estimation.estimate(objective, one.q[None])) for one in best]
        return finalists(ranked(body, settled), _FINALISTS)


def staying(scene: Scene) -> list[int]:
    """Numbers of the persons that stay in place."""
    return [k for k, person in enumerate(scene.persons) if person.body.stays]


def beside(start: Start, fixed: Start) -> Start:
    """A start in which some persons were held, combined with the one that found them."""
    found = start.hypotheses or ((),) * len(start.poses)
    return replace(start, hypotheses=tuple(a or b for a, b in zip(found, fixed.hypotheses, strict=True)))


def _everywhere(body: BodyModel) -> Array:
    """(N, dof) the reference pose, and others all over the limits: half a turn, or the body's extent, if unlimited."""
    rest, extent = body.rest(), float(np.ptp(body.model_from_parts[:, :3, 3], axis=0).max())
    reach = np.where(body.rotates, np.pi, extent)
    free = np.ptp(body.limits, axis=1) > 2 * reach
    low = np.where(free, rest - reach, body.limits[:, 0])
    high = np.where(free, rest + reach, body.limits[:, 1])
    poses = low + halton(_TRIED, body.dof) * (high - low)
    return body.clamped(np.vstack([rest, poses]))
