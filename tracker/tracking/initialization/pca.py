"""Iterative-PCA bootstrapping (Gavrila & Davis 1996, section 4.1): start poses from the moving foreground."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from typing import TypeVar

import numpy as np
import pydantic

from tracker.bodies.body import BodyModel
from tracker.bodies.limbs import turned_round
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import BackdropError, ConfigError, InitializationError
from tracker.foundation.progress import Tally
from tracker.images.plate import Plate
from tracker.images.sight import Sight
from tracker.synthesis import side_by_side
from tracker.tracking.estimation.best_first import BestFirstEstimation
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.hypotheses import (
    finalists,
    hypothesis,
    least_left,
    likeliest,
    ranked,
    with_held,
)
from tracker.tracking.initialization import Stages
from tracker.tracking.initialization._coarse_search import CoarseSearch, check_values
from tracker.tracking.initialization._drafts import Draft, cleared, likeliest_of
from tracker.tracking.initialization._foregrounds import foregrounds, outlined, segmented
from tracker.tracking.initialization._person_sized import person_sized
from tracker.tracking.initialization._persons import Found, in_order, size_of, standing, ways_to_find
from tracker.tracking.initialization._placement import axis_marks, stands_upright, without_legs
from tracker.tracking.initialization._upper_bodies import has_upper_body_alone, upper_poses
from tracker.tracking.initialization._visual_hull import TorsoAxis, hull_axis, region_axes, torso_axis
from tracker.tracking.objective import Objective
from tracker.tracking.start import AxisFit, Hypothesis, Start

# Shadows hide more of a low person: in two frames the right pose was fourth to sixth before the run's estimation, and
# first after it.
_MORE_OF_LOW = 2
# In a renewed search a woman who walked in left over 0.12 to 0.27, shadows of the man beside her 0.44 to 0.64.
_MOST_LEFT_OVER = 0.5
# Share of the best coarse pose in the foreground, against plates that are unknown in places: 0.65 to 1 in three frames
# of eight recordings; 0.45 in two of a woman who is in such plates herself. Searched from there, which took 18 s, she
# ended 150 m away.
_LEAST_COVERED = 0.5

# How many times as far off as the best one a pose may be after the first steps of the fine search. Right ones were 1.16
# times as far at most; of 28 hypotheses of a turn 17 are given up. See docs/lab/start_costs.md.
_BEHIND = 1.2

_One = TypeVar("_One")
_Made = TypeVar("_Made")


@component
class PcaInitialization:
    """Background subtraction, iterated PCA in every view, the body's axis in space, then a coarse-to-fine search.

    Persons must not overlap in the images, before a known background. A standing person has the head up. A lower one
    may lie either way round the axis, or crouch, sit or lie as in the stances of the body's file. The axis of a body
    that lies in its model file, an animal's trunk, is followed both ways. A body whose legs do not move need not be
    whole in
    the images: its head is a top of the foreground.
    """

    min_area: float = pydantic.Field(default=0.002, gt=0, lt=1)
    """Least share of an image that a person's region covers in a view that counts."""

    turn_step_deg: float = pydantic.Field(default=15.0, gt=0, le=90)
    """Step of the turn over the full circle in the coarse search, degrees."""

    coarse_deg: dict[str, tuple[float, ...]] | None = None
    """Values of further parameters tried with every turn in the coarse search, degrees. None takes those of the body's
    file; set it if persons hold their arms differently at the beginning."""

    hypotheses: int = pydantic.Field(default=4, ge=1)
    """Coarse poses for the fine search; their turns are at least `apart_deg` apart."""

    apart_deg: float = pydantic.Field(default=40.0, ge=0)
    """Least difference of the turns of two hypotheses, degrees."""

    fine: BestFirstEstimation = BestFirstEstimation(
        range_deg=60.0, step_deg=20.0, range_m=0.1, step_m=0.05, halvings=2, patience=3
    )
    """Fine search around each hypothesis."""

    refinement: TwistIcpEstimation = TwistIcpEstimation()
    """Refinement after the fine search."""

    finalists: int = pydantic.Field(default=3, ge=1)
    """Refined hypotheses, different from one another, for the run's own estimation; one more if all of them face one
    way."""

    def check(self, scene: Scene, plates: tuple[Plate | None, ...]) -> str:
        """Needs the plates of two views, and bodies with an axis; see `initialization.Initialization.check`."""
        lacking = [name for name, plate in zip(scene.rig.names, plates, strict=True) if plate is None]
        n_plates = len(plates) - len(lacking)
        if n_plates < 2:
            raise ConfigError(
                f"bootstrapping needs the background of at least two views, {n_plates} given (none of "
                f'{", ".join(lacking)}): add `background = "background/{{view}}.png"` to [reading], or start without '
                'plates by initialization = { use = "stance" } or { use = "given", poses = "start.csv" }'
            )
        for person in scene.persons:
            axis_marks(person.body)
            check_values(self.coarse_deg, person.body)
        return f"pca, the background plates of {n_plates} views"

    @person_sized
    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        """Poses of all persons in one frame; see `tracker.tracking.initialization.Initialization.start`."""
        stages.progress(f"start: foreground in {sum(plate is not None for plate in stages.plates)} views")
        masks = foregrounds(frame, stages.plates)
        _enough(masks, frame, scene)
        sought = [k for k in range(len(scene.persons)) if k not in stages.held]
        if len(sought) == 1 and has_upper_body_alone(scene.persons[sought[0]].body):
            return self._of_upper_body(sought[0], frame, scene, stages, masks)
        if not any(plate is not None and plate.unknown is not None for plate in stages.plates):
            stages = stages.counting("start: pose")
            found = self._drafts(frame, scene, stages, self._ways(masks, scene, stages))
            return self._settled(found, stages.counting("start: finalist", sum(one.n_hypotheses for one in found)))
        stages = stages.counting("start: pose")
        drawn = segmented(frame, stages.plates)
        ways = side_by_side(stages.synthesis, _or_fault(lambda masks: self._ways(masks, scene, stages)), (drawn, masks))
        tried = (frame, ways[0]), (frame, ways[1]), (outlined(frame, stages.plates, drawn), ways[0])

        def drafted(one: tuple[Frame, list[list[Found]] | InitializationError]) -> list[Draft]:
            if isinstance(one[1], InitializationError):
                raise one[1]
            return self._drafts(one[0], scene, stages, one[1])

        outcomes = side_by_side(stages.synthesis, _or_fault(drafted), tried)
        drafts = likeliest_of([one for one in outcomes if isinstance(one, list)], 2 * self.finalists)
        if not drafts:
            raise _likeliest_fault([one for one in reversed(outcomes) if isinstance(one, InitializationError)])
        stages = stages.counting("start: finalist", sum(draft.n_hypotheses for ways in drafts for draft in ways))
        starts = side_by_side(stages.synthesis, lambda ways: self._settled(ways, stages), drafts)
        return least_left(starts, scene, self.finalists)

    def _of_upper_body(
        self, k: int, frame: Frame, scene: Scene, stages: Stages, masks: tuple[Mask | None, ...]
    ) -> Start:
        """The start of person k, whose legs do not move, below the tops of masks (H, W) of the foreground.

        Hypotheses are ranked by their distances, because each of them leaves over all edges of the foreground that are
        not the person's: a board in the hands, clothes, rims of unknown regions.
        """
        alone, body = with_held(scene, k, stages.held), scene.persons[k].body
        poses = upper_poses(body, scene.rig, masks, None if stages.seen_before else scene.persons[k].at)
        if not len(poses):
            raise InitializationError(f"frame {frame.index}: no top of the foreground is a head")
        stages.progress(f"start: {len(poses)} poses of {scene.persons[k].name} below the highest tops")
        if any(plate is not None and plate.unknown is not None for plate in stages.plates):
            frame = outlined(frame, stages.plates, segmented(frame, stages.plates))
        objective = stages.objective(frame, alone, len(alone.persons) - 1)
        stages = stages.counting("start: pose")
        refined = self._all_refined(objective, self._coarse(objective).upper(poses), stages.tally)
        nearest = min(refined, key=lambda one: one.distance_px)
        refined += self._all_refined(objective, [turned_round(body, nearest.q)], stages.tally)
        best = finalists(_by_distance(body, refined), _MORE_OF_LOW * self.finalists)
        stages = stages.counting("start: finalist", len(best))
        settled = []
        for one in best:
            stages.tally.begin()
            settled.append(hypothesis(body, stages.estimation.estimate(objective, one.q[None])))
        ranking = finalists(_by_distance(body, settled), self.finalists)
        own = [other == k for other in range(len(scene.persons))]
        return Start(
            tuple(person.q for person in scene.with_pose(k, ranking[0].q).persons),
            ((),) * len(own),
            tuple(ranking if mine else () for mine in own),
        )

    def _ways(self, masks: tuple[Mask | None, ...], scene: Scene, stages: Stages) -> list[list[Found]]:
        """The ways to find the persons sought in the foregrounds (H, W) of all views."""
        persons = tuple(person for k, person in enumerate(scene.persons) if k not in stages.held)
        if stages.seen_before:
            persons = tuple(replace(person, at=None) for person in persons)
        found = ways_to_find(masks, scene.rig, persons, tuple(scene.persons[k] for k in stages.held))
        # who is looked for again is looked for often
        return list(islice(found, 1 if stages.seen_before else None))

    def _drafts(self, frame: Frame, scene: Scene, stages: Stages, ways: list[list[Found]]) -> list[Draft]:
        """Start of each way to find the persons."""

        def drafted(way: list[Found]) -> Draft:
            return self._draft(way, frame, scene, stages)

        if len(ways) == 1:
            return [drafted(ways[0])]
        found = [_or_fault(drafted)(way) for way in ways]
        if drafts := [one for one in found if isinstance(one, Draft)]:
            return drafts
        none = InitializationError(
            f"frame {frame.index}: {len(ways)} bodies in the foreground, and none is like a person"
        )
        raise _likeliest_fault([none, *(one for one in found if isinstance(one, InitializationError))])

    def _settled(self, ways: list[Draft], stages: Stages) -> Start:
        """The start from all ways to find the persons in one foreground, by the run's own estimation."""
        starts = [draft.settled(stages, self.finalists) for draft in ways]
        return starts[0] if len(ways) == 1 else likeliest(starts, ways[0].scene, self.finalists, bodies=True)

    def _draft(self, found: list[Found], frame: Frame, scene: Scene, stages: Stages) -> Draft:
        """Hypotheses of the persons sought, each searched for before the next."""
        sought = [k for k in range(len(scene.persons)) if k not in stages.held]
        persons = tuple(scene.persons[k] for k in sought)
        evidence: list[tuple[AxisFit | None, ...]] = [()] * len(scene.persons)
        hypotheses: list[tuple[Hypothesis, ...]] = [()] * len(scene.persons)
        ordered = in_order(found, persons, scene.rig, stages.seen_before)
        for k, person in zip(sought, ordered, strict=True):
            axes, evidence[k] = self._axes(without_legs(person, scene.persons[k].body, scene.rig), scene.rig)
            hypotheses[k] = self._search(frame, with_held(scene, k, stages.held), stages, person, axes)
            if stages.seen_before and hypotheses[k][0].left_over > _MOST_LEFT_OVER:
                raise InitializationError(
                    f"frame {frame.index}: the foreground is not like {scene.persons[k].name}: the best pose leaves "
                    f"over {hypotheses[k][0].left_over:.0%} of the contour, expected at most {_MOST_LEFT_OVER:.0%}"
                )
            scene = scene.with_pose(k, hypotheses[k][0].q)
        return Draft(frame, scene, tuple(ordered), tuple(evidence), tuple(hypotheses))

    def _axes(self, person: Found, rig: Rig) -> tuple[list[TorsoAxis], tuple[AxisFit | None, ...]]:
        """The torso's axis from the views and from the hull, and the picture of the former."""
        axes = region_axes(person.regions, self.min_area)
        fits = tuple(
            AxisFit(region, tuple(one.ends for one in found)) if region is not None and found else None
            for region, found in zip(person.regions, axes, strict=True)
        )
        candidates = [hull_axis(person.points)]
        # Where too few views show the axis, or all from one side, there is the hull's.
        with contextlib.suppress(InitializationError):
            candidates.insert(0, torso_axis(rig, person.regions, axes))
        return candidates, fits

    def _search(
        self, frame: Frame, scene: Scene, stages: Stages, found: Found, axes: list[TorsoAxis]
    ) -> tuple[Hypothesis, ...]:
        """Coarse-to-fine search of the turn and the limbs of the scene's last person: the best hypothesis first."""
        body = scene.persons[-1].body
        near = cleared(frame, scene, stages, [found], range(len(scene.persons) - 1))
        objective = stages.objective(near, scene, len(scene.persons) - 1)
        points = without_legs(found, body, scene.rig).points
        coarse = self._coarse(objective)
        tried = coarse.along(axes, points)
        low = stands_upright(body) and not standing(points, size_of(scene.persons[-1]).stature_m)
        if low:
            tried += coarse.low(axes, points)
        if any(plate is not None and plate.unknown is not None for plate in stages.plates):
            _stand_out(frame, scene, stages, tried)
        refined = self._all_refined(objective, tried, stages.tally)
        refined += self._all_refined(objective, [turned_round(body, ranked(body, refined)[0].q)], stages.tally)
        return finalists(ranked(body, refined), _MORE_OF_LOW * self.finalists if low else self.finalists)

    def _coarse(self, objective: Objective) -> CoarseSearch:
        """The coarse search as configured, with the values of the body's file in place of missing ones."""
        values = objective.body.start.coarse_deg if self.coarse_deg is None else self.coarse_deg
        return CoarseSearch(objective, values, self.turn_step_deg, self.hypotheses, self.apart_deg)

    def _all_refined(self, objective: Objective, poses: list[Array], tally: Tally) -> list[Hypothesis]:
        """Results of the fine search and the refinement for poses (dof,), except those that the best one leads clearly.

        Each is searched with the first steps before any is searched with finer ones.
        """
        tally.expect(2 * len(poses))
        begun = []
        for q in poses:
            tally.begin()
            begun.append(self.fine.search_level(objective, q, 0)[0])
        distances = objective(np.array(begun))
        near = [q for q, distance in zip(begun, distances, strict=True) if distance <= _BEHIND * distances.min()]
        tally.expect(len(near) - len(poses))
        refined = []
        for q in near:
            tally.begin()
            for level in range(1, self.fine.halvings + 1):
                q, _ = self.fine.search_level(objective, q, level)
            refined.append(hypothesis(objective.body, self.refinement.estimate(objective, q[None])))
        return refined


def _by_distance(body: BodyModel, hypotheses: list[Hypothesis]) -> tuple[Hypothesis, ...]:
    """Different hypotheses, the one of least distance first."""
    return ranked(body, hypotheses, np.array([one.distance_px for one in hypotheses]))


def _stand_out(frame: Frame, scene: Scene, stages: Stages, poses: list[Array]) -> None:
    """Refuses poses (dof,) of a scene's last person that lie, whatever the others do, on unchanged pixels.

    Raises:
        BackdropError: all of them do.
    """
    sight, alone = Sight(frame, stages.plates), Scene(scene.persons[-1:], scene.rig)
    covered = max(sight.covered(stages.synthesis.silhouettes(alone.with_pose(0, q))) for q in poses)
    if covered < _LEAST_COVERED:
        raise BackdropError(
            f"frame {frame.index}: at most {covered:.0%} of {alone.persons[0].name} would stand out, expected at least "
            f"{_LEAST_COVERED:.0%}"
        )


def _or_fault(find: Callable[[_One], _Made]) -> Callable[[_One], _Made | InitializationError]:
    """The same, but it returns the reason if no person is found."""

    def tried(one: _One) -> _Made | InitializationError:
        try:
            return find(one)
        except InitializationError as fault:
            return fault

    return tried


def _likeliest_fault(faults: list[InitializationError]) -> InitializationError:
    """The first reason of several ways, except that a person in the plates comes before it."""
    return next((one for one in faults if isinstance(one, BackdropError)), faults[0])


def _enough(masks: tuple[Mask | None, ...], frame: Frame, scene: Scene) -> None:
    lacking = [name for name, mask in zip(scene.rig.names, masks, strict=True) if mask is None]
    if len(masks) - len(lacking) < 2:
        raise InitializationError(
            f"frame {frame.index}: no foreground in {', '.join(lacking)}: the images are missing or differ everywhere "
            "from the background plates; take plates in this light, with the cameras where they are"
        )
