"""One turn of the cycle: a frame's estimates, with or without those of the frame before."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from tracker.bodies.contours import Contours, joined
from tracker.bodies.scene import Scene
from tracker.evidence import Observed
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.measures.part_colours import PartColours, colours_when_asked
from tracker.foundation.arrays import Array
from tracker.foundation.errors import InitializationError
from tracker.images.sight import Sight
from tracker.tracking.clock import Clock
from tracker.tracking.cycle import Cycle, State
from tracker.tracking.estimate import Estimate, Status
from tracker.tracking.loss import LossRule, doubted, is_out_of_sight, judged, sought_anew
from tracker.tracking.objective import Objective
from tracker.tracking.other_places import in_likeliest_places
from tracker.tracking.outcome import finished, still_lost
from tracker.tracking.overlap import judged_in_space
from tracker.tracking.single_view import with_vague_limbs
from tracker.tracking.start import Start
from tracker.tracking.strangers import hide_strangers
from tracker.tracking.trajectory import History, Step
from tracker.tracking.verdict import explains_better, weighed


def advance(
    sight: Sight,
    scene: Scene,
    cycle: Cycle,
    state: State,
    clock: Clock | None = None,
    rivals: Sequence[Estimate] = (),
    again: Sequence[Array | None] = (),
) -> Step:
    """One frame: predict, expect, observe, estimate; the search begins anew for lost persons.

    Args:
        sight: the images, perhaps with results computed in advance.
        scene: all persons at their last poses.
        cycle: the components.
        state: histories up to the frame before.
        clock: with the time spent on the frame before.
        rivals: for each person the result of another way in this frame; empty for none.
        again: for each person the pose (dof,) that is only refined, unless doubt remains; None and empty for none.
    """
    clock = clock or Clock()
    with clock("prediction"):
        candidates = _predictions(scene, cycle, state, sight.frame.time_s)
        predicted = scene.with_poses(tuple(poses[0] for poses in candidates))
    with clock("synthesis"):
        around = [np.vstack([poses, *(one.q for one in rivals[k : k + 1])]) for k, poses in enumerate(candidates)]
        drawn = [cycle.synthesis.contours(predicted, k, poses) for k, poses in enumerate(around)]
        expected = joined(drawn)
    with clock("observation"):
        if not state.anybody_lost:  # or they may be the persons sought
            hide_strangers(sight, predicted, cycle.synthesis)
        observed = cycle.evidence.observe(sight, expected, state.memory)
    found_of, current = dict[int, Estimate](), predicted
    colours = colours_when_asked(sight)
    with clock("refinement"):
        for k in _most_shown_first(predicted, lambda: drawn[0]):
            # Earlier persons are at their best poses by now, later ones as predicted (paper, figure 2).
            objective = objective_of(current, k, cycle, observed, colours, state.histories[k])
            objective = replace(objective, nearby=is_out_of_sight(state.troubles[k], cycle.loss))
            rival = rivals[k] if rivals and not rivals[k].lost else None
            found = _refined(objective, again[k] if again else None, cycle)
            if found is None:
                estimate = cycle.estimation.estimate(objective, candidates[k])
                if rival is not None:
                    estimate = weighed(objective, estimate, rival)
                found = judged_by(objective, estimate, cycle.loss)
            found_of[k] = found
            current = current.with_pose(k, found.q)
    estimates = [found_of[k] for k in range(len(candidates))]
    clock.move("refinement", "search", sum(estimate.search_s for estimate in estimates))
    start = None
    # a person in another one's contours, or where no view shows anything, is lost; otherwise the search would begin
    # anew in every frame: 5 s each, for a person who had not come in yet
    estimates = list(judged_in_space(current, tuple(estimates)))
    frames_lost = tuple(one.lost for one in state.troubles)
    estimates = still_lost(sight, current, cycle.synthesis, estimates, frames_lost, cycle.loss.least_views)
    pairs = enumerate(zip(estimates, state.troubles, strict=True))
    sought = [k for k, (one, before) in pairs if sought_anew(one, before, cycle.loss)]
    if sought:
        with clock("initialization"):
            current, estimates, start = _recover(sight, current, cycle, state, estimates, sought)
    step = finished(sight, current, cycle.synthesis, tuple(estimates), clock, cycle.loss.least_views)
    return replace(step, start=start)


def _most_shown_first(scene: Scene, draw: Callable[[], Contours]) -> list[int]:
    """Persons, those first who show most contour in the first pose: the order of their names does not matter."""
    if len(scene.persons) == 1:
        return [0]
    contours = draw()
    shown = np.bincount(contours.parts[0][contours.valid[0]], minlength=len(scene.shapes))
    begins = [scene.first_part(k) for k in range(len(scene.persons))]
    lengths = np.add.reduceat(shown, begins)
    return sorted(range(len(begins)), key=lambda k: -lengths[k])


def _refined(objective: Objective, q: Array | None, cycle: Cycle) -> Estimate | None:
    """The estimate from an earlier pose; None without one, and if it is in doubt."""
    if q is None:
        return None
    estimate = judged_by(objective, cycle.estimation.estimate(objective, q[None]), cycle.loss)
    return None if estimate.lost or doubted(estimate) else estimate


def settled(
    sight: Sight, scene: Scene, cycle: Cycle, observed: Observed, found: Status, whom: Collection[int] = ()
) -> tuple[tuple[Estimate, ...], Scene]:
    """Estimates of all persons started from the poses of the scene itself.

    Args:
        sight: the images.
        scene: the persons.
        cycle: the components.
        observed: by the evidence.
        found: status of persons who are not lost.
        whom: persons whose limbs are searched wherever they may be.
    """
    colours, found_of = colours_when_asked(sight), dict[int, Estimate]()
    for k in _most_shown_first(scene, partial(cycle.synthesis.contours, scene)):
        objective = objective_of(scene, k, cycle, observed, colours)
        estimate = cycle.estimation.estimate(objective, scene.persons[k].q[None])
        if k in whom:
            estimate = in_likeliest_places(objective, estimate)
        found_of[k] = judged_by(objective, estimate, cycle.loss, found)
        scene = scene.with_pose(k, estimate.q)
    return tuple(found_of[k] for k in range(len(scene.persons))), scene


def objective_of(
    scene: Scene,
    k: int,
    cycle: Cycle,
    observed: Observed,
    colours: Callable[[Scene], PartColours] | None = None,
    history: History | None = None,
) -> Objective:
    """The objective of a scene's person k, with the others in place."""
    asked = Comparison(scene, k, cycle.synthesis, observed)
    return Objective(asked, cycle.evidence, history, colours=colours).by_surface()


def judged_by(objective: Objective, estimate: Estimate, loss: LossRule, found: Status = Status.TRACKED) -> Estimate:
    """The estimate with its status and all doubts."""
    return with_vague_limbs(objective, judged(objective.body, estimate, loss, found), loss.elsewhere_px)


def _predictions(scene: Scene, cycle: Cycle, state: State, time_s: float) -> list[Array]:
    """Candidate poses of each person; a lost person waits at the last known place."""
    candidates = []
    for person, history, so_far in zip(scene.persons, state.histories, state.troubles, strict=True):
        if history is None or so_far.lost:
            candidates.append((person.q if history is None else history.poses[-1])[None])
        else:
            candidates.append(cycle.prediction.predict(person.body, history, time_s))
    return candidates


def _recover(
    sight: Sight, scene: Scene, cycle: Cycle, state: State, estimates: list[Estimate], sought: list[int]
) -> tuple[Scene, list[Estimate], Start | None]:
    """Initializes the persons sought anew, and accepts poses that explain the images better."""
    recovered = list(estimates)
    for k in sought:
        if not recovered[k].lost and state.troubles[k].lost:
            recovered[k] = replace(recovered[k], status=Status.RECOVERED)
    if not cycle.seeks:
        return scene, recovered, None
    held = tuple(k for k in range(len(scene.persons)) if k not in sought)
    try:
        start = cycle.initialization.start(sight.frame, scene, replace(cycle.stages, held=held, seen_before=True))
    except InitializationError:
        return scene, recovered, None
    poses = [start.poses[k] if k in sought else person.q for k, person in enumerate(scene.persons)]
    trial = scene.with_poses(tuple(poses))
    expected = joined([cycle.synthesis.contours(scene), cycle.synthesis.contours(trial)])
    observed = cycle.evidence.observe(sight, expected, state.memory)
    again, _ = settled(sight, trial, cycle, observed, Status.RECOVERED, sought)
    colours = colours_when_asked(sight)
    for k in sought:
        judge = objective_of(scene, k, cycle, observed, colours)
        if not again[k].lost and (recovered[k].lost or explains_better(judge, scene.persons[k].q, again[k].q)):
            recovered[k] = again[k]
            scene = scene.with_pose(k, again[k].q)
    return scene, recovered, start
