"""Searches for an uncertain start in the next seconds, where it may be easier, and follows it back from there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.errors import InitializationError
from tracker.images.sight import Sight
from tracker.tracking.backwards import as_replay, frames_before, tracked_back
from tracker.tracking.bootstrapping import settled_where_found
from tracker.tracking.cycle import Cycle, State
from tracker.tracking.estimate import Estimate
from tracker.tracking.rehearsal import Reopen, nats_in, rehearsed
from tracker.tracking.start import RATHER_RIGHT, Start
from tracker.tracking.trajectory import Replay, Step


@dataclass(frozen=True)
class LedBack:
    """Frames tracked backwards from a later start."""

    index: int
    """The frame of the start."""

    start: Start
    """The start found in it."""

    replays: Mapping[int, Replay]
    """Every frame from the first one to that of the start."""

    def start_in(self, frame: Frame) -> Start | None:
        """The start, in its own frame."""
        return self.start if frame.index == self.index else None


def led_back(step: Step, scene: Scene, cycle: Cycle, reopen: Reopen) -> LedBack | None:
    """Finds a surer start in one of the next seconds, and the frames up to it.

    Where a person is first seen, limbs may hide, or front and back look the same; a moment later they may not.

    Args:
        step: the first frame, with the start found in it.
        scene: the persons and the rig.
        cycle: the components; its loss rule says where to search, and which start is sure enough.
        reopen: opens the sequence anew.

    Returns:
        None if the start is more likely right than wrong, or given, if no later one is surer, or if the images of the
        first frame support its own.
    """
    if step.start is None or step.start.given or step.start.least_sureness >= RATHER_RIGHT:
        return None
    found = _surest(step, scene, cycle, reopen)
    if found is None:
        return None
    frame, start = found
    if start.least_sureness <= step.start.least_sureness:
        return None
    replays = _followed_back(step.frame.index, frame, scene.with_poses(start.poses), cycle, reopen)
    better = _gained_nats(step, replays[step.frame.index].estimates, scene, cycle) > 0
    return LedBack(frame.index, start, replays) if better else None


def _gained_nats(step: Step, back: Sequence[Estimate], scene: Scene, cycle: Cycle) -> float:
    """By how much poses led back to a frame are more probable than those found in it, nats."""
    scene, gained = scene.with_poses(tuple(one.q for one in back)), 0.0
    for k, (found, led) in enumerate(zip(step.estimates, back, strict=True)):
        here, there = nats_in(step.frame, scene, k, np.array([found.q, led.q]), cycle)
        gained += float(here - there)
    return gained


def _surest(step: Step, scene: Scene, cycle: Cycle, reopen: Reopen) -> tuple[Frame, Start] | None:
    """The surest start in the searched frames; None if no person is found in them.

    The search goes on while no start, including the first one, is more likely right than wrong.
    """
    rule, here = cycle.loss, 0.0 if step.start is None else step.start.least_sureness
    best = _looked_for(step.frame, rule.look_ahead_s, rule.sure, scene, cycle, reopen)
    if max(here, _sureness(best)) < RATHER_RIGHT:
        best = max(best, _looked_for(step.frame, rule.look_on_s, RATHER_RIGHT, scene, cycle, reopen), key=_sureness)
    return best


def _sureness(found: tuple[Frame, Start] | None) -> float:
    return -1.0 if found is None else found[1].least_sureness


def _looked_for(
    first: Frame, delays_s: tuple[float, ...], enough: float, scene: Scene, cycle: Cycle, reopen: Reopen
) -> tuple[Frame, Start] | None:
    """The surest start after the given delays, the first one that is sure enough."""
    best: tuple[Frame, Start] | None = None
    for n, frame in enumerate(_later(first, reopen, delays_s), start=1):
        cycle.progress(f"start: uncertain, frame {frame.index} searched, {n} of {len(delays_s)} later ones at most")
        try:
            start = cycle.initialization.start(frame, scene, cycle.stages)
        except InitializationError:
            continue
        start = rehearsed(start, frame, scene, cycle, reopen)
        if start.least_sureness > _sureness(best):
            best = frame, start
        if start.least_sureness >= enough:
            break
    return best


def _later(first: Frame, reopen: Reopen, delays_s: tuple[float, ...]) -> Iterator[Frame]:
    """The frames after given delays."""
    left = sorted(delays_s)
    for frame in reopen():
        if not left:
            return
        if frame.index > first.index and frame.time_s >= first.time_s + left[0]:
            left = [delay_s for delay_s in left if frame.time_s < first.time_s + delay_s]
            yield frame


def _followed_back(first: int, last: Frame, scene: Scene, cycle: Cycle, reopen: Reopen) -> dict[int, Replay]:
    """The frames from `last` back to the number `first`, as estimates; the start is that of the scene.

    The way back shows where this start leads, so no other search is made on it. Balancing without plates, from frame
    10, was led back from a wrong start in frame 40 with a search of 60 s in every frame or two: 22 minutes of processor
    time for a result 31 mm off either way.
    """
    cycle = replace(cycle, seeks=False)
    sight = Sight(last, cycle.plates)
    estimates, scene = settled_where_found(sight, scene, cycle)
    step = Step(last, scene, estimates, cycle.synthesis.contours(scene))
    state = State.before(scene).after(sight, step, cycle.evidence, cycle.loss)
    replays = {last.index: as_replay(step)}
    for earlier in tracked_back(frames_before(last, first, reopen), step, state, cycle, 2 * last.time_s):
        cycle.progress(f"start: followed back to frame {first}, {earlier.frame.index - first} frames to go")
        replays[earlier.frame.index] = as_replay(earlier)
    return replays
