"""The tracking cycle of Gavrila & Davis 1996, figure 1: predict, synthesize, analyse, estimate."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np
import pydantic

from tracker.analysis import Analysis, Looked, LooksAhead
from tracker.arrays import Array, Image, frozen
from tracker.components import component
from tracker.contours import Contours, joined
from tracker.errors import InitializationError
from tracker.estimate import Estimate, Status
from tracker.estimation import Estimation
from tracker.frame import Frame
from tracker.initialization import Initialization, Stages
from tracker.objective import Objective
from tracker.observation import Observation
from tracker.prediction import Prediction
from tracker.scene import Scene
from tracker.similarity import Similarity
from tracker.start import Start
from tracker.synthesis import Synthesis
from tracker.trajectory import History, Step


@component
class LossRule:
    """When a person counts as lost, and how it is looked for again."""

    lost_below: float = pydantic.Field(default=0.4, ge=0, le=1)
    """Share of the visible contour on scene edges under which a person is lost."""

    restart_every: int = pydantic.Field(default=3, ge=1)
    """A lost person is initialized anew in the frame of the loss and then every so many frames."""

    start_within: int = pydantic.Field(default=25, ge=1)
    """Frames in which the first initialization must succeed."""

    rehearse: int = pydantic.Field(default=10, ge=0)
    """Frames into which the likeliest start poses of an uncertain person are tracked before one is chosen, 0 for none.
    They are at least 0.03 s apart."""

    sure: float = pydantic.Field(default=0.8, ge=0, le=1)
    """Confidence of a start pose that needs no rehearsal."""


@dataclass(frozen=True)
class Cycle:
    """The components of the cycle and the clean plates they may use."""

    synthesis: Synthesis
    analysis: Analysis
    similarity: Similarity
    prediction: Prediction
    estimation: Estimation
    initialization: Initialization
    loss: LossRule
    backgrounds: tuple[Image | None, ...]
    progress: Callable[[str], None] = field(default=lambda message: None)

    @property
    def stages(self) -> Stages:
        """What the initialization may use."""
        return Stages(self.synthesis, self.analysis, self.similarity, self.estimation, self.backgrounds, self.progress)


@dataclass(frozen=True)
class State:
    """Everything that changes while tracking: the histories, and for how long each person has been lost."""

    histories: tuple[History | None, ...]
    frames_lost: tuple[int, ...]

    def after(self, frame: Frame, estimates: Sequence[Estimate]) -> State:
        """The state one frame on."""
        histories, frames_lost = [], []
        for history, lost, estimate in zip(self.histories, self.frames_lost, estimates, strict=True):
            if history is not None:
                history = history.after(frame.time_s, estimate)
            elif not estimate.lost:
                history = History.start(frame.time_s, estimate.q)
            histories.append(history)
            frames_lost.append(lost + 1 if estimate.lost else 0)
        return State(tuple(histories), tuple(frames_lost))


def advance(
    frame: Frame,
    scene: Scene,
    cycle: Cycle,
    state: State,
    looked: Looked | None = None,
    clock: Clock | None = None,
) -> Step:
    """One frame: predict, expect, observe, estimate; lost persons are looked for anew.

    Args:
        frame: the images.
        scene: all persons at their last poses.
        cycle: the components.
        state: histories up to the frame before.
        looked: what the analysis has seen in the images already.
        clock: with the time spent on the frame before.
    """
    clock = clock or Clock()
    with clock("prediction"):
        candidates = _predictions(scene, cycle, state, frame.time_s)
        predicted = scene.with_poses(tuple(poses[0] for poses in candidates))
    with clock("synthesis"):
        expected = joined([cycle.synthesis.contours(predicted, k, poses) for k, poses in enumerate(candidates)])
    with clock("analysis"):
        if looked is not None and isinstance(cycle.analysis, LooksAhead):
            observation = cycle.analysis.judge(looked, frame, expected, cycle.backgrounds)
        else:
            observation = cycle.analysis.observe(frame, expected, cycle.backgrounds)
    estimates, current = [], predicted
    with clock("refinement"):
        for k, poses in enumerate(candidates):
            # Earlier persons are at their best poses by now, later ones as predicted (paper, figure 2).
            objective = Objective(current, k, cycle.synthesis, cycle.similarity, observation, state.histories[k])
            estimate = cycle.estimation.estimate(objective, poses)
            estimates.append(_judged(estimate, cycle.loss))
            current = current.with_pose(k, estimate.q)
    clock.move("refinement", "search", sum(estimate.search_s for estimate in estimates))
    start = None
    sought = [k for k, estimate in enumerate(estimates) if _sought(estimate, state.frames_lost[k], cycle.loss)]
    if sought:
        with clock("initialization"):
            current, estimates, start = _recover(frame, current, cycle, estimates, sought)
    step = _finished(frame, current, cycle, tuple(estimates), observation, clock)
    return replace(step, start=start, predicted=predicted, expected=expected)


def bootstrap(
    frame: Frame, scene: Scene, cycle: Cycle, give_up: bool = False, choose: Callable[[Start], Start] | None = None
) -> Step:
    """Finds all persons without a prediction; a step of lost persons where none can be found.

    Args:
        frame: the images.
        scene: the persons and the rig.
        cycle: the components.
        give_up: raise instead of reporting the persons lost.
        choose: has the last word on what was found.

    Raises:
        InitializationError: nothing was found and `give_up` is set.
    """
    clock = Clock()
    start: Start | None = None
    with clock("initialization"):
        try:
            start = cycle.initialization.start(frame, scene, cycle.stages)
            start = start if choose is None else choose(start)
            scene = scene.with_poses(start.poses)
        except InitializationError:
            if give_up:
                raise
    with clock("analysis"):
        expected = None if start is None else cycle.synthesis.contours(scene)
        observation = cycle.analysis.observe(frame, expected, cycle.backgrounds)
    if start is None:
        return _finished(frame, scene, cycle, _unfound(scene, cycle, observation), observation, clock)
    with clock("refinement"):
        estimates, scene = settled(scene, cycle, observation, Status.BOOTSTRAPPED)
    clock.move("refinement", "search", sum(estimate.search_s for estimate in estimates))
    if give_up and all(estimate.lost for estimate in estimates):
        share = max(estimate.explained for estimate in estimates)
        raise InitializationError(
            f"frame {frame.index}: the best start pose explains {share:.0%} of the model's contour, expected at "
            f"least {cycle.loss.lost_below:.0%}; check the background plates, the calibration and the model's "
            'size, or give a pose with initialization = { use = "given", poses = "start.csv" }'
        )
    return replace(_finished(frame, scene, cycle, estimates, observation, clock), start=start)


def settled(scene: Scene, cycle: Cycle, observation: Observation, found: Status) -> tuple[tuple[Estimate, ...], Scene]:
    """Estimates of all persons started from the poses of the scene itself."""
    estimates = []
    for k, person in enumerate(scene.persons):
        objective = Objective(scene, k, cycle.synthesis, cycle.similarity, observation)
        estimate = cycle.estimation.estimate(objective, person.q[None])
        estimates.append(_judged(estimate, cycle.loss, found))
        scene = scene.with_pose(k, estimate.q)
    return tuple(estimates), scene


def _unfound(scene: Scene, cycle: Cycle, observation: Observation) -> tuple[Estimate, ...]:
    """Estimates of persons of whom nothing is known."""
    estimates = []
    for k, person in enumerate(scene.persons):
        objective = Objective(scene, k, cycle.synthesis, cycle.similarity, observation)
        nothing = np.full((person.body.dof, person.body.dof), np.nan)
        estimates.append(replace(objective.estimate(person.q, nothing, 0), status=Status.LOST))
    return tuple(estimates)


def _predictions(scene: Scene, cycle: Cycle, state: State, time_s: float) -> list[Array]:
    """Candidate poses of each person; one that is lost waits where it was seen last."""
    candidates = []
    for person, history, lost in zip(scene.persons, state.histories, state.frames_lost, strict=True):
        if history is None or lost:
            candidates.append((person.q if history is None else history.poses[-1])[None])
        else:
            candidates.append(cycle.prediction.predict(person.body, history, time_s))
    return candidates


def _judged(estimate: Estimate, loss: LossRule, found: Status = Status.TRACKED) -> Estimate:
    return replace(estimate, status=Status.LOST if estimate.explained < loss.lost_below else found)


def _sought(estimate: Estimate, frames_lost: int, loss: LossRule) -> bool:
    """Whether a person is looked for anew in this frame.

    One that was lost is, even when the pose it was lost at explains the images again: limbs have moved meanwhile.
    """
    return frames_lost % loss.restart_every == 0 if estimate.lost else frames_lost > 0


def _recover(
    frame: Frame, scene: Scene, cycle: Cycle, estimates: list[Estimate], sought: list[int]
) -> tuple[Scene, list[Estimate], Start | None]:
    """Initializes anew and takes over the poses of the persons sought where they explain the images better."""
    recovered = list(estimates)
    for k in sought:
        if not recovered[k].lost:
            recovered[k] = replace(recovered[k], status=Status.RECOVERED)
    held = tuple(k for k in range(len(scene.persons)) if k not in sought)
    try:
        start = cycle.initialization.start(frame, scene, replace(cycle.stages, held=held, seen_before=True))
    except InitializationError:
        return scene, recovered, None
    poses = [start.poses[k] if k in sought else person.q for k, person in enumerate(scene.persons)]
    trial = scene.with_poses(tuple(poses))
    expected = joined([cycle.synthesis.contours(scene), cycle.synthesis.contours(trial)])
    observation = cycle.analysis.observe(frame, expected, cycle.backgrounds)
    again, _ = settled(trial, cycle, observation, Status.RECOVERED)
    for k in sought:
        old = Objective(scene, k, cycle.synthesis, cycle.similarity, observation).evidence(scene.persons[k].q)
        if not again[k].lost and (recovered[k].lost or again[k].distance_px < old.distance_px):
            recovered[k] = again[k]
            scene = scene.with_pose(k, again[k].q)
    return scene, recovered, start


def _finished(
    frame: Frame,
    scene: Scene,
    cycle: Cycle,
    estimates: tuple[Estimate, ...],
    observation: Observation,
    clock: Clock,
) -> Step:
    with clock("synthesis"):
        fitted: Contours = cycle.synthesis.contours(scene)
        overlap = _overlap(scene, cycle, observation)
    return Step(frame, scene, estimates, fitted, clock.seconds, overlap, observation=observation)


def _overlap(scene: Scene, cycle: Cycle, observation: Observation) -> Array | None:
    """Intersection over union (V,) of the model's and the foreground's silhouettes."""
    if all(view is None or view.silhouette is None for view in observation.views):
        return None
    shares = np.full(len(observation.views), np.nan)
    for v, mask in enumerate(cycle.synthesis.silhouettes(scene)):
        view = observation.views[v]
        if view is not None and view.silhouette is not None:
            union = np.count_nonzero(mask | view.silhouette)
            shares[v] = np.count_nonzero(mask & view.silhouette) / union if union else np.nan
    return frozen(shares)


class Clock:
    """Seconds spent in each stage of one frame."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def move(self, stage: str, other: str, seconds: float) -> None:
        """Books some of a stage's time to another one."""
        if seconds > 0:
            self.seconds[stage] -= seconds
            self.seconds[other] = self.seconds.get(other, 0.0) + seconds

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Books the time spent in the block."""
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - begin
