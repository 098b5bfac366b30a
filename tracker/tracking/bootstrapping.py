"""The first frame of the cycle: all persons without a prediction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tracker.bodies.limbs import are_apart
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.evidence import Observed
from tracker.foundation.errors import InitializationError
from tracker.images.sight import Sight
from tracker.tracking.clock import Clock
from tracker.tracking.cycle import Cycle
from tracker.tracking.cycle_turn import objective_of, settled
from tracker.tracking.doubt import Because, Doubt
from tracker.tracking.estimate import Estimate, Status
from tracker.tracking.outcome import finished
from tracker.tracking.start import Start
from tracker.tracking.strangers import hide_strangers
from tracker.tracking.trajectory import Step

# See docs/lab/first_edges.md.
_ROUNDS = 4
"""Largest number of observations around the poses found, while limbs move."""


def bootstrap(
    sight: Sight, scene: Scene, cycle: Cycle, give_up: bool = False, choose: Callable[[Start], Start] | None = None
) -> Step:
    """Finds all persons without a prediction; returns a step of lost persons if it cannot.

    Args:
        sight: the images.
        scene: the persons and the rig.
        cycle: the components.
        give_up: raise instead of reporting the persons lost.
        choose: makes the final choice.

    Raises:
        InitializationError: no pose was found and `give_up` is set.
        GivenUpError: no pose was found in the allowed time.
    """
    clock = Clock()
    start: Start | None = None
    why = ""
    with clock("initialization"):
        try:
            start = first_start(sight.frame, scene, cycle)
            start = start if choose is None else choose(start)
            scene = scene.with_poses(start.poses)
        except InitializationError as error:
            if give_up:
                raise
            why = str(error)
    if start is None:
        return replace(unfound(sight, scene, cycle, clock), why_unfound=why)
    with clock("refinement"):
        estimates, scene = settled_where_found(sight, scene, cycle)
    clock.move("refinement", "search", sum(estimate.search_s for estimate in estimates))
    if give_up and all(estimate.lost for estimate in estimates):
        share = max(estimate.account.explained for estimate in estimates)
        raise InitializationError(
            f"frame {sight.frame.index}: the best start pose explains {share:.0%} of the model's contour, expected at "
            f"least {cycle.loss.lost_below:.0%}; check the background plates, the calibration and the model's "
            'size, or give a pose with initialization = { use = "given", poses = "start.csv" }'
        )
    return replace(finished(sight, scene, cycle.synthesis, estimates, clock, cycle.loss.least_views), start=start)


def first_start(frame: Frame, scene: Scene, cycle: Cycle) -> Start:
    """The start of a run in a frame; the same search is not repeated in a frame where it was in vain.

    Args:
        frame: the images.
        scene: the persons and the rig.
        cycle: the components; its loss rule limits the cost of all such searches of a run.

    Raises:
        InitializationError: no person was found.
        GivenUpError: the allowed time is over.
    """
    if (known := cycle.before.start_in(frame.index)) is not None:
        return known
    stages, patience = cycle.stages, cycle.patience
    asked = (*(person.body for person in scene.persons), *stages.plates, cycle.initialization)
    if why := patience.why_not(frame.index, asked):
        raise InitializationError(why)
    with patience.spending(cycle.loss.start_within_s, cycle.progress) as watched:
        watched(f"start: search for {' and '.join(person.name for person in scene.persons)} in frame {frame.index}")
        try:
            return cycle.initialization.start(frame, scene, replace(stages, progress=watched))
        except InitializationError as error:
            patience.in_vain(frame.index, asked, str(error))
            raise


def unfound(sight: Sight, scene: Scene, cycle: Cycle, clock: Clock | None = None) -> Step:
    """A frame without a search, or in which it was in vain.

    Args:
        sight: the images.
        scene: the persons and the rig.
        cycle: the components.
        clock: with the time spent on the frame before.
    """
    clock = clock or Clock()
    with clock("observation"):
        observed = cycle.evidence.observe(sight, None)
    estimates = _of_nobody(scene, cycle, observed)
    return finished(sight, scene, cycle.synthesis, estimates, clock, cycle.loss.least_views)


def settled_where_found(sight: Sight, scene: Scene, cycle: Cycle) -> tuple[tuple[Estimate, ...], Scene]:
    """Estimates of all persons; the images are observed anew around them until no limb moves any more.

    Strangers hide them before.

    Edges are found near expected contours, so that a limb's true place has fewer of them than its present one. A leg
    that was started kicking (7.2 px) came down by half (8.0 px); with another observation there it hangs as it does
    (6.2 px). With one observation it was up in 43 frames.
    """
    hide_strangers(sight, scene, cycle.synthesis)
    everybody = range(len(scene.persons))
    for _ in range(_ROUNDS):
        expected = scene
        observed = cycle.evidence.observe(sight, cycle.synthesis.contours(expected))
        estimates, scene = settled(sight, expected, cycle, observed, Status.BOOTSTRAPPED, everybody)
        pairs = zip(expected.persons, estimates, strict=True)
        if not any(are_apart(person.body, one.q, person.q) for person, one in pairs):
            break
    return estimates, scene


def _of_nobody(scene: Scene, cycle: Cycle, observed: Observed) -> tuple[Estimate, ...]:
    """Estimates of persons without any information."""
    estimates = []
    for k, person in enumerate(scene.persons):
        objective = objective_of(scene, k, cycle, observed)
        nothing = np.full((person.body.dof, person.body.dof), np.nan)
        estimates.append(objective.estimate(person.q, nothing, 0).losing(Doubt("", Because.NOT_FOUND)))
    return tuple(estimates)
