"""A start without background plates: one person, looked for all over the floor in several stances, on edges alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pydantic

from tracker.arrays import Array
from tracker.body import BodyModel
from tracker.components import component
from tracker.errors import ConfigError, InitializationError
from tracker.frame import Frame
from tracker.initialization import Stages
from tracker.initialization._directions import DirectionImages, direction_images
from tracker.initialization._floor import floor_places, shown_share
from tracker.initialization._hypotheses import different, hypothesis, ranked, turned_round, with_held
from tracker.initialization._scattering import ROUNDS, scattered
from tracker.initialization._stances import on_floor, posed, turned
from tracker.plate import Plate
from tracker.scene import Person, Scene
from tracker.start import Hypothesis, Start, confidence
from tracker.synthesis.cpu import CpuSynthesis

# Poses at a time: bounds the memory.
_BATCH = 256
# Contours for thousands of poses: a third of the samples that estimates are made with.
_ROUGH = CpuSynthesis(step_px=16.0, n_eta=6, n_omega=12)
# A view counts for a place if it shows so much of a person's landmarks.
_WHOLE = 0.9
# What clutter offers it offers in one view; a person is in all of them.
_DISAGREEMENT = 0.5
# Best coarse poses that are tried at half the steps, and how far poses must be apart to be tried twice.
_AGAIN, _APART_M = 60, 0.25
# Of the poses that are refined, so many are stances as they are: of who stands they are often nearer.
_PLAIN = 2
# Refined poses with so much less of the best one's score are not ranked.
_BELIEVED = 0.7
# What is left over counts edges near the pose that a refinement began with: only from the second time on it can be
# compared. In a simulation of somebody face down, one refinement ranked the pose turned round first, two did not.
_TIMES = 2
# Who was lost is not far from where it was seen last: two running strides.
_NEAR_M = 2.0


@component
class StanceInitialization:
    """Tries stances at every place and turn that two views show; refines the best ones. For one person."""

    stances_deg: tuple[dict[str, float], ...] | None = None
    """Poses tried, degrees; a name stands for both sides. None takes those of the body's file."""

    floor_m: float = pydantic.Field(default=0.0, ge=-100, le=100)
    """Height of the floor, metres."""

    farthest_m: float = pydantic.Field(default=10.0, gt=0)
    """Floor farther than this from a camera is not searched, metres."""

    step_m: float = pydantic.Field(default=0.3, gt=0)
    """Step of the places, metres; the best poses are tried again at half of it."""

    step_deg: float = pydantic.Field(default=40.0, gt=0, le=90)
    """Step of the turns about the vertical, degrees; the best poses are tried again at half of it."""

    reach: float = pydantic.Field(default=0.035, gt=0, lt=1)
    """Share of an image's longer side at which an edge has no effect on the coarse search; 25 px of 720."""

    hypotheses: int = pydantic.Field(default=6, ge=1)
    """Poses that are refined, different from one another."""

    finalists: int = pydantic.Field(default=3, ge=1)
    """Refined hypotheses, different from one another, that may be tracked into the next frames to choose between."""

    least_score: float = pydantic.Field(default=0.16, ge=0, le=1)
    """Least share of what edges can gain that the best refined pose gains, chance being 0; below it nobody was found.
    In empty rooms something reached 0.09 to 0.13, up to 94 % of its contour on edges; persons reach 0.2 to 0.37."""

    def check(self, scene: Scene, plates: tuple[Plate | None, ...]) -> str:
        """Needs one person, and floor that the views show; see `tracker.initialization.Initialization.check`."""
        if len(scene.persons) != 1:
            raise ConfigError(
                f"without background plates one person can be looked for, {len(scene.persons)} are asked for: add "
                '`background = "background/{view}.png"` to [reading], or give the poses by '
                'initialization = { use = "given", poses = "start.csv" }'
            )
        candidates = self._candidates(scene, None)
        if not len(candidates):
            raise ConfigError(
                "there is no place on the floor where two views show a whole person: check floor_m, farthest_m and the "
                'calibration, or give the pose by initialization = { use = "given", poses = "start.csv" }'
            )
        area = len(floor_places(scene.rig, self.floor_m, self.step_m, self.farthest_m)) * self.step_m**2
        n_stances = len(self._stances(scene.persons[0].body))
        return f"stance, no background plates: one person in {n_stances} stances on {area:.0f} m2 of floor"

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        """The pose of one person; see `tracker.initialization.Initialization.start`."""
        sought = [k for k in range(len(scene.persons)) if k not in stages.held]
        if len(sought) != 1:
            raise InitializationError(f"frame {frame.index}: without background plates one person can be looked for")
        alone = with_held(scene, sought[0], stages.held)
        body, edges = alone.persons[-1].body, direction_images(frame, self.reach)
        if edges.empty:
            raise InitializationError(f"frame {frame.index}: the images have no edges, nobody can be looked for")
        refined = []
        for n, q in enumerate(self._tried(frame, alone, stages, edges), start=1):
            stages.progress(f"bootstrapping: stance {n} of {self.hypotheses}")
            refined.append(_refined(frame, alone, stages, q))
        stages.progress("bootstrapping: the best stance turned round")
        back = turned_round(body, _ranked(alone, refined, edges)[0].q)
        ranking = _ranked(alone, [*refined, _refined(frame, alone, stages, back)], edges)[: self.finalists]
        score = float(_scores(alone, ranking[0].q[None], edges)[0])
        if score < self.least_score:
            raise InitializationError(
                f"frame {frame.index}: what is likest to a person has a score of {score:.2f} on the edges, expected at "
                f"least {self.least_score:.2f}"
            )
        return _start(scene, sought[0], ranking, confidence(ranking, _costs(alone, ranking, edges)))

    def _tried(self, frame: Frame, scene: Scene, stages: Stages, edges: DirectionImages) -> list[Array]:
        """The poses (dof,) of the scene's last person that the edges speak for, the likeliest first."""
        body = scene.persons[-1].body
        near = scene.persons[-1] if stages.seen_before else None
        candidates = self._candidates(scene, near)
        if not len(candidates):
            raise InitializationError(f"frame {frame.index}: two views no longer show the person's whereabouts")
        stages.progress(f"bootstrapping: {len(candidates)} poses on the floor")
        scores = _scores(scene, candidates, edges)
        best = different(body, candidates[np.argsort(-scores, kind="stable")], _AGAIN, _APART_M)
        finer = self._around(body, best)
        finer = finer[np.argsort(-_scores(scene, finer, edges), kind="stable")]
        stages.progress("bootstrapping: the likeliest poses scattered")
        found = scattered(body, finer, lambda poses: _scores(scene, poses, edges), ROUNDS)
        plain = different(body, finer, _PLAIN, _APART_M)
        return different(body, np.array([*plain, *found]), self.hypotheses, _APART_M)

    def _stances(self, body: BodyModel) -> tuple[dict[str, float], ...]:
        return body.start.stances_deg if self.stances_deg is None else self.stances_deg

    def _candidates(self, scene: Scene, near: Person | None) -> Array:
        """Poses (N, dof) of the last person on the floor that two views show."""
        body = scene.persons[-1].body
        places = floor_places(scene.rig, self.floor_m, self.step_m, self.farthest_m)
        if near is not None:
            last = body.landmarks_in_world(near.q)[:, :2].mean(axis=0)
            places = places[np.linalg.norm(places - last, axis=1) < _NEAR_M]
        headings = np.radians(np.arange(-180.0, 180.0 - 1e-9, self.step_deg))
        poses = np.concatenate([turned(body, posed(body, stance), headings) for stance in self._stances(body)])
        poses = on_floor(body, poses, np.zeros((len(poses), 2)), self.floor_m)
        candidates = np.repeat(poses, len(places), axis=0)
        candidates[:, body.root.shifts[:2]] += np.tile(places, (len(poses), 1))
        shown = shown_share(body, candidates, scene.rig)
        enough = (shown > _WHOLE).sum(axis=1) >= min(2, len(scene.rig))
        found: Array = candidates[enough]
        return found

    def _around(self, body: BodyModel, poses: list[Array]) -> Array:
        """(N, dof) poses and their neighbours at half a step to each side."""
        headings = np.radians(self.step_deg / 2) * np.array([-1.0, 0.0, 1.0])
        sides = self.step_m / 2 * np.array([-1.0, 0.0, 1.0])
        shifts = np.stack(np.meshgrid(sides, sides), axis=-1).reshape(-1, 2)
        found = []
        for q in poses:
            marks = body.landmarks_in_world(q)[:, :2]
            places = (marks.min(axis=0) + marks.max(axis=0)) / 2 + shifts
            ways = np.repeat(turned(body, q, headings), len(places), axis=0)
            found.append(on_floor(body, ways, np.tile(places, (len(headings), 1)), self.floor_m))
        return np.concatenate(found)


def _scores(scene: Scene, poses: Array, edges: DirectionImages) -> Array:
    """(N,) how well the contours of poses of the last person lie on edges; what is out of sight counts as chance."""
    k = len(scene.persons) - 1
    batches = [poses[i : i + _BATCH] for i in range(0, len(poses), _BATCH)]
    shown = shown_share(scene.persons[k].body, poses, scene.rig)
    found = shown * np.concatenate([edges.scores(_ROUGH.contours(scene, k, batch)) for batch in batches])
    scores: Array = found.mean(axis=1) - _DISAGREEMENT * found.std(axis=1)
    return scores


def _ranked(scene: Scene, hypotheses: list[Hypothesis], edges: DirectionImages) -> tuple[Hypothesis, ...]:
    """Those that all views speak for, the one of least cost first.

    What is left over counts what is in sight only: of a body half out of sight that may be next to nothing.
    """
    scores = _scores(scene, np.array([one.q for one in hypotheses]), edges)
    believed = np.flatnonzero(scores >= _BELIEVED * scores.max())
    kept = [hypotheses[n] for n in believed]
    return ranked(scene.persons[-1].body, kept, _costs(scene, kept, edges))


def _costs(scene: Scene, hypotheses: Sequence[Hypothesis], edges: DirectionImages) -> Array:
    """(N,) what hypotheses leave over, times their distance, over their score on the edges.

    Each alone ranks somebody turned round first in two of five starts, not in the same ones, and so does this. Where
    they disagree the lead is small, and the frames after it decide.
    """
    scores = _scores(scene, np.array([one.q for one in hypotheses]), edges)
    left = np.array([one.left_over * one.distance_px for one in hypotheses])
    costs: Array = left / np.maximum(scores, 1e-3)
    return costs


def _refined(frame: Frame, scene: Scene, stages: Stages, q: Array) -> Hypothesis:
    """What the run's estimation makes of a pose (dof,) of the scene's last person, from the edges near it."""
    k = len(scene.persons) - 1
    for _ in range(_TIMES):
        objective = stages.objective(frame, scene, k, stages.synthesis.contours(scene, k, q[None]))
        estimate = stages.estimation.estimate(objective, q[None])
        q = estimate.q
    return hypothesis(objective.body, estimate)


def _start(scene: Scene, k: int, ranking: tuple[Hypothesis, ...], sure: float) -> Start:
    """The start of person k, the others where they are."""
    scene = scene.with_pose(k, ranking[0].q)
    mine = [other == k for other in range(len(scene.persons))]
    return Start(
        tuple(person.q for person in scene.persons),
        ((),) * len(mine),
        tuple(ranking if own else () for own in mine),
        tuple(sure if own else 1.0 for own in mine),
    )
