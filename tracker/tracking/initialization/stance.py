"""A start without background plates: searches the floor in several stances, on edges alone."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pydantic

from tracker.bodies.body import BodyModel
from tracker.bodies.limbs import turned_round
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import ConfigError, InitializationError
from tracker.foundation.progress import Progress, Tally
from tracker.images.plate import Plate
from tracker.images.sight import LEAST_COVERED
from tracker.tracking.hypotheses import different, finalists, with_held
from tracker.tracking.initialization import Stages
from tracker.tracking.initialization._edge_ranking import Clues, all_refined_on_edges, refined_on_edges
from tracker.tracking.initialization._floor import floor_places, shown_share
from tracker.tracking.initialization._limbs_anew import limbs_anew
from tracker.tracking.initialization._person_sized import enlarged, enlargement, person_sized
from tracker.tracking.initialization._persons import size_of
from tracker.tracking.initialization._placement import Whereabouts, last_seen, whereabouts
from tracker.tracking.initialization._stance_search import (
    ROUNDS,
    DirectionImages,
    direction_images,
    on_floor,
    posed,
    scattered,
    turned,
)
from tracker.tracking.start import Hypothesis, Start

# A view counts for a place if it shows so much of a person's landmarks; all but knees and feet where images cut people.
_WHOLE, _PARTLY = 0.9, 0.6
# Best coarse poses that are tried at half the steps, and how far poses must be apart to be tried twice.
_AGAIN, _APART_M = 60, 0.25
# Share of the refined poses that are unchanged stances: for standing persons they are often nearer.
_PLAIN = 2
# Poses after which is told how many are left: some seconds.
_TOLD = 4096


@component
class StanceInitialization:
    """Tries stances at every place and turn that two views show; refines the best ones.

    It searches all over the floor for one person, and where something moves for several.
    """

    stances_deg: tuple[dict[str, float], ...] | None = pydantic.Field(default=None, min_length=1)
    """Poses tried, degrees; a name stands for both sides. None takes those of the body's file."""

    floor_m: float = pydantic.Field(default=0.0, ge=-100, le=100)
    """Height of the floor, metres."""

    farthest_m: float = pydantic.Field(default=10.0, gt=0)
    """Floor farther than this from a camera is not searched, metres; for a body as large as a person."""

    step_m: float = pydantic.Field(default=0.3, gt=0)
    """Step of the places for such a body, metres; the best poses are tried again at half of it."""

    step_deg: float = pydantic.Field(default=40.0, gt=0, le=90)
    """Step of the turns about the vertical, degrees; the best poses are tried again at half of it."""

    reach: float = pydantic.Field(default=0.035, gt=0, lt=1)
    """Share of an image's longer side at which an edge has no effect on the coarse search; 25 px of 720."""

    hypotheses: int = pydantic.Field(default=6, ge=1)
    """Poses that are refined, different from one another."""

    finalists: int = pydantic.Field(default=3, ge=1)
    """Refined hypotheses, different from one another, for tracking into the next frames; one more if all of them face
    one way."""

    # See docs/lab/two_persons_without_plates.md.
    least_score: float = pydantic.Field(default=0.16, gt=0, le=1)
    """Least share of the possible gain on edges of the best refined pose, chance being 0; below it no person was found.
    In empty rooms scores reached 0.09 to 0.13, up to 94 % of the contour on edges; persons reach 0.2 to 0.37."""

    def check(self, scene: Scene, plates: tuple[Plate | None, ...]) -> str:
        """Needs visible floor; see `tracker.tracking.initialization.Initialization.check`."""
        factor = enlargement(scene)
        return self.in_world(factor)._checked(scene if factor == 1 else enlarged(scene, factor), factor)

    def in_world(self, factor: float) -> StanceInitialization:
        """The component for a world enlarged by a factor."""
        return replace(self, floor_m=factor * self.floor_m)

    def _checked(self, scene: Scene, factor: float) -> str:
        n_stances = len(self._stances(scene.persons[-1].body))
        if not len(self._candidates(scene, None)):
            if len(scene.persons) > 1 or not len(self._posed_on(scene, self._cut_off_places(scene), _PARTLY)):
                raise ConfigError(
                    "there is no place on the floor where two views show a whole person: check floor_m, farthest_m and "
                    'the calibration, or give the pose by initialization = { use = "given", poses = "start.csv" }'
                )
            return f"stance, no background plates: one person cut off by the images, in {n_stances} stances"
        area = len(floor_places(scene.rig, self.floor_m, self.step_m, self.farthest_m)) * (self.step_m / factor) ** 2
        who = "one person" if len(scene.persons) == 1 else f"{len(scene.persons)} persons where something moves,"
        return f"stance, no background plates: {who} in {n_stances} stances on {area:.{int(area < 1)}f} m2 of floor"

    @person_sized
    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        """The poses of all persons sought; see `tracker.tracking.initialization.Initialization.start`."""
        sought = [k for k in range(len(scene.persons)) if k not in stages.held]
        edges = direction_images(frame, self.reach)
        if edges.empty:
            raise InitializationError(f"frame {frame.index}: the images have no edges, so no person can be found")
        near = whereabouts(frame, scene, stages) if len(sought) > 1 else [last_seen(scene, sought[0], stages)]
        try:
            return self._found(frame, scene, stages, edges, near)
        except InitializationError:
            if len(sought) > 1 or stages.seen_before:
                raise
            # For a person on floor that no view shows, hidden by a board in one.
            with contextlib.suppress(InitializationError):
                near = [where._replace(partly=True) for where in whereabouts(frame, scene, stages)]
                return self._found(frame, scene, stages, edges, near)
            raise

    def _found(
        self,
        frame: Frame,
        scene: Scene,
        stages: Stages,
        edges: DirectionImages,
        near: Sequence[Whereabouts | None],
    ) -> Start:
        """The poses of all persons sought, near their possible places.

        Raises:
            InitializationError: there may be no person.
        """
        sought = [k for k in range(len(scene.persons)) if k not in stages.held]
        clues = [Clues(edges) if one is None else Clues(edges, one.moved, one.partly) for one in near]
        rankings: dict[int, tuple[Hypothesis, ...]] = {}
        for k, clue, where in zip(sought, clues, near, strict=True):
            alone = with_held(scene, k, (*stages.held, *rankings))
            rankings[k] = self._search(frame, alone, stages, clue, where)
            scene = scene.with_pose(k, rankings[k][0].q)
        for k, clue in zip(sought, clues, strict=True):
            others = with_held(scene, k, tuple(other for other in range(len(scene.persons)) if other != k))
            if len(sought) > 1:
                # A person whom others hide was judged before they were found.
                stages = stages.counting(f"start: {scene.persons[k].name} beside the others, pose", len(rankings[k]))
                again = all_refined_on_edges(frame, others, stages, [one.q for one in rankings[k]])
                rankings[k] = clue.ranked(others, again)
                scene = scene.with_pose(k, rankings[k][0].q)
            self._confirm(frame, others, rankings[k], clue)
        return _start(scene, rankings)

    def _confirm(self, frame: Frame, scene: Scene, ranking: tuple[Hypothesis, ...], clues: Clues) -> None:
        """Refuses a scene's last person if there are too few edges; a moving person exists, however few there are.

        Raises:
            InitializationError: it may be no person.
        """
        if not self._is_there(scene, ranking[0], clues):
            score = float(clues.scores(scene, ranking[0].q[None])[0])
            raise InitializationError(
                f"frame {frame.index}: the likeliest person has a score of {score:.2f} on the edges, expected at "
                f"least {self.least_score:.2f}"
            )

    def _is_there(self, scene: Scene, best: Hypothesis, clues: Clues) -> bool:
        """Whether a scene's last person is where the edges are, or the movement."""
        if clues.moved.known:
            covered = clues.moved.covered(scene.persons[-1].body, best.q[None], scene.rig)
            if not clues.partly or float(covered[0]) >= LEAST_COVERED:
                return True
        return float(clues.scores(scene, best.q[None])[0]) >= self.least_score

    def _search(
        self, frame: Frame, scene: Scene, stages: Stages, clues: Clues, near: Whereabouts | None
    ) -> tuple[Hypothesis, ...]:
        """Refined poses of the scene's last person, the best one first."""
        tried, body = self._tried(frame, scene, stages, clues, near), scene.persons[-1].body
        stages = stages.counting("start: likely pose", len(tried) + 1)
        refined = all_refined_on_edges(frame, scene, stages, tried)
        back = refined_on_edges(frame, scene, stages, turned_round(body, clues.ranked(scene, refined)[0].q))
        ranking = clues.ranked(scene, [*refined, back])
        if self._is_there(scene, ranking[0], clues):
            ranking = clues.ranked(scene, [*ranking, *limbs_anew(frame, scene, stages, clues, ranking[0])])
        return finalists([*ranking, back], self.finalists)  # however little speaks for it: frames after it may

    def _tried(self, frame: Frame, scene: Scene, stages: Stages, clues: Clues, near: Whereabouts | None) -> list[Array]:
        """The poses (dof,) of the scene's last person with the best scores on edges, the likeliest first."""
        body, candidates = scene.persons[-1].body, self._candidates(scene, near)
        if not len(candidates):
            raise InitializationError(f"frame {frame.index}: two views do not show the person's surroundings")
        scores = _scored(scene, clues, candidates, stages.progress)
        best = different(body, candidates[np.argsort(-scores, kind="stable")], _AGAIN, _APART_M)
        finer = self._around(body, best)
        finer = finer[np.argsort(-clues.scores(scene, finer), kind="stable")]
        tally = Tally(stages.progress, "start: around the likeliest poses, round", len(ROUNDS))

        def score(poses: Array) -> Array:
            tally.begin()
            return clues.scores(scene, poses)

        found = scattered(body, finer, score, ROUNDS)
        plain = different(body, finer, _PLAIN, _APART_M)
        return different(body, np.array([*plain, *found]), self.hypotheses, _APART_M)

    def _stances(self, body: BodyModel) -> tuple[dict[str, float], ...]:
        return body.start.stances_deg if self.stances_deg is None else self.stances_deg

    def _candidates(self, scene: Scene, near: Whereabouts | None) -> Array:
        """Poses (N, dof) of the last person on the floor that two views show."""
        if near is not None and near.partly:
            return self._posed_on(scene, near.hold(self._cut_off_places(scene)), _PARTLY)
        places = floor_places(scene.rig, self.floor_m, self.step_m, self.farthest_m)
        return self._posed_on(scene, places if near is None else near.hold(places), _WHOLE)

    def _cut_off_places(self, scene: Scene) -> Array:
        """Places (N, 2) on the floor above which two views show the middle of a standing person, metres."""
        middle_m = self.floor_m + size_of(scene.persons[-1]).stature_m / 2
        return floor_places(scene.rig, middle_m, self.step_m, self.farthest_m)

    def _posed_on(self, scene: Scene, places: Array, least_shown: float) -> Array:
        """(N, dof) all stances at places (P, 2) of which two views show enough, in all turns."""
        body = scene.persons[-1].body
        headings = np.radians(np.arange(-180.0, 180.0 - 1e-9, self.step_deg))
        poses = np.concatenate([turned(body, posed(body, stance), headings) for stance in self._stances(body)])
        poses = on_floor(body, poses, np.zeros((len(poses), 2)), self.floor_m)
        candidates = np.repeat(poses, len(places), axis=0)
        candidates[:, body.root.shifts[:2]] += np.tile(places, (len(poses), 1))
        enough = (shown_share(body, candidates, scene.rig) > least_shown).sum(axis=1) >= min(2, len(scene.rig))
        found: Array = candidates[enough]
        return found

    def _around(self, body: BodyModel, poses: list[Array]) -> Array:
        """(N, dof) poses and their neighbours at half a step to each side."""
        headings = np.radians(self.step_deg / 2) * np.array([-1.0, 0.0, 1.0])
        shifts = self.step_m / 2 * np.stack(np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]), axis=-1).reshape(-1, 2)
        found = []
        for q in poses:
            marks = body.landmarks_in_world(q)[:, :2]
            places = (marks.min(axis=0) + marks.max(axis=0)) / 2 + shifts
            ways = np.repeat(turned(body, q, headings), len(places), axis=0)
            found.append(on_floor(body, ways, np.tile(places, (len(headings), 1)), self.floor_m))
        return np.concatenate(found)


def _scored(scene: Scene, clues: Clues, poses: Array, progress: Progress) -> Array:
    """(N,) scores of poses (N, dof) of a scene's last person; see `Clues.scores`."""
    found = []
    for i in range(0, len(poses), _TOLD):
        progress(f"start: pose {i} of {len(poses)} of {scene.persons[-1].name} on the floor")
        found.append(clues.scores(scene, poses[i : i + _TOLD]))
    return np.concatenate(found)


def _start(scene: Scene, rankings: Mapping[int, tuple[Hypothesis, ...]]) -> Start:
    """The start of the persons sought, the others unchanged."""
    every = range(len(scene.persons))
    return Start(
        tuple(person.q for person in scene.persons),
        ((),) * len(every),
        tuple(rankings.get(k, ()) for k in every),
    )
