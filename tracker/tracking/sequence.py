"""Tracks a sequence: the cycle frame after frame, while the next frame is decoded and prepared."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

import cv2

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.images.sight import Sight
from tracker.tracking.bootstrapping import bootstrap, unfound
from tracker.tracking.clock import Clock
from tracker.tracking.cycle import Cycle, State
from tracker.tracking.cycle_turn import advance
from tracker.tracking.easier_start import LedBack, led_back
from tracker.tracking.estimate import Status
from tracker.tracking.outcome import covered_px
from tracker.tracking.rehearsal import Reopen, rehearsed
from tracker.tracking.start import Start
from tracker.tracking.trajectory import Replay, Step

_NOTHING: Mapping[int, Replay] = MappingProxyType({})


def track(
    frames: Iterator[Frame],
    scene: Scene,
    cycle: Cycle,
    done: Mapping[int, Replay] = _NOTHING,
    reopen: Reopen | None = None,
) -> Iterator[Step]:
    """Tracks all persons through a sequence.

    Args:
        frames: synchronized images in order.
        scene: the persons (their poses do not matter) and the rig.
        cycle: the components.
        done: frames already tracked by an interrupted run, by number; they are replayed, not estimated again.
        reopen: opens the sequence anew, for rehearsals and later starts of uncertain persons; None for neither.

    Yields:
        One step a frame.

    Raises:
        InitializationError: the first frames show no start pose.
    """
    state, step = State.before(scene), None
    back: LedBack | None = None
    with Ahead(frames, cycle, done) as ahead:
        n_frames = 0
        while True:
            clock = Clock()
            with clock("waiting"):
                sight = ahead.next(step)
            if sight is None:
                return
            frame = sight.held
            n_frames += frame.index >= cycle.nobody_before
            looking = Looking(n_frames >= cycle.loss.start_within, reopen, back)
            if frame.index in done:
                if state.nobody_found and _was_led_back(done[frame.index]):
                    _, back = _begun(sight, scene, cycle, looking)
                step = replayed(frame, scene, cycle, done[frame.index])
            else:
                step, back = tracked(sight, scene, cycle, state, looking, clock)
            state = state.after(sight, step, cycle.evidence, cycle.loss)
            scene = step.scene
            yield step


@dataclass(frozen=True)
class Looking:
    """Settings of the search for the first persons."""

    give_up: bool
    """Raise if no person is found."""

    reopen: Reopen | None
    """Opens the sequence anew; None if only this frame may be used."""

    back: LedBack | None = None
    """First frames from a surer start in a later one."""


def tracked(
    sight: Sight, scene: Scene, cycle: Cycle, state: State, looking: Looking, clock: Clock | None = None
) -> tuple[Step, LedBack | None]:
    """One frame, and the first ones from a surer start in a later one.

    Args:
        sight: the images.
        scene: all persons at their last poses.
        cycle: the components.
        state: histories up to the frame before.
        looking: settings of the search, until a person is found.
        clock: with the time spent on the frame before.

    Raises:
        InitializationError: no person was found, and that is an error.
    """
    begun, back = None, looking.back
    if state.nobody_found:
        begun, back = _begun(sight, scene, cycle, looking)
    if back is not None and sight.frame.index in back.replays:
        replay = back.replays[sight.frame.index]
        return replayed(sight.held, scene, cycle, replay, back.start_in(sight.frame)), back
    if begun is not None:
        step = begun
    else:
        index, before = sight.frame.index, cycle.before
        known, again = before.estimates.get(index, ()), before.gone_again(scene, index)
        step = advance(sight, scene, cycle, state, clock, known, again)
    if back is not None and step.start is None:
        step = replace(step, start=back.start_in(sight.frame))
    return step, back


def _begun(sight: Sight, scene: Scene, cycle: Cycle, looking: Looking) -> tuple[Step, LedBack | None]:
    """The first frame, perhaps from a surer start in a later one."""
    if sight.frame.index < cycle.nobody_before:
        return unfound(sight, scene, cycle), None
    if cycle.before.believed:
        return bootstrap(sight, scene, cycle, looking.give_up), None
    choose = partial(rehearsed, frame=sight.frame, scene=scene, cycle=cycle, reopen=looking.reopen)
    step = bootstrap(sight, scene, cycle, looking.give_up, choose)
    return step, None if looking.reopen is None else led_back(step, scene, cycle, looking.reopen)


def _was_led_back(replay: Replay) -> bool:
    """Whether a first pose came from a later frame: frames that an interrupted run has not kept repeat this."""
    return any(estimate.status is Status.TRACKED for estimate in replay.estimates)


class Ahead:
    """Decodes and prepares the next frame during the estimation of the one before, in its own thread.

    It prepares around the outcome two frames before, which a resumed run knows as well, so that both do the same.
    """

    def __init__(self, frames: Iterable[Frame], cycle: Cycle, replays: Mapping[int, Replay] = _NOTHING) -> None:
        """Nothing is decoded yet.

        Args:
            frames: in order.
            cycle: the components; the evidence prepares its part.
            replays: frames without a search.
        """
        self._frames, self._cycle, self._replays = iter(frames), cycle, replays
        self._worker = ThreadPoolExecutor(max_workers=1)
        self._waiting: Future[Sight | None] | None = None
        self._threads = 1

    def __enter__(self) -> Ahead:
        # OpenCV's own threads wait for work in a loop: 3 of the 70 ms of processor time of a frame, for nothing. Their
        # number is the whole process's; it is put back at the end.
        self._threads = cv2.getNumThreads()
        cv2.setNumThreads(1)
        return self

    def __exit__(self, *error: object) -> None:
        cv2.setNumThreads(self._threads)
        self._worker.shutdown(cancel_futures=True)

    def next(self, before: Step | None) -> Sight | None:
        """The next frame with the prepared data, None at the end; starts on the one after it.

        Args:
            before: outcome of the frame before the one that is returned.
        """
        if self._waiting is None:
            self._waiting = self._worker.submit(self._fetch, before)
        found = self._waiting.result()
        self._waiting = self._worker.submit(self._fetch, before)
        return found

    def _fetch(self, before: Step | None) -> Sight | None:
        frame = next(self._frames, None)
        if frame is None:
            return None
        sight = Sight(frame, self._cycle.plates, None if before is None else before.model_px)
        if before is not None and frame.index not in self._replays:
            self._cycle.evidence.look(sight, before.fitted)
        return sight


def replayed(frame: Frame, scene: Scene, cycle: Cycle, replay: Replay, start: Start | None = None) -> Step:
    """The step of a frame whose estimates are known.

    Args:
        frame: the images.
        scene: the persons and the rig.
        cycle: the components.
        replay: the estimates.
        start: the start, if one was searched in this frame.
    """
    scene = scene.with_poses(tuple(estimate.q for estimate in replay.tracked))
    fitted = cycle.synthesis.contours(scene)
    compared = replay.overlap is not None
    model_px = covered_px(cycle.synthesis.silhouettes(scene) if compared else (), replay.tracked)
    step = Step(frame, scene, replay.tracked, fitted, dict(replay.seconds), replay.overlap)
    step = replace(step, model_px=model_px, untrusted=replay.untrusted, strangers=replay.strangers)
    return replace(step, start=start, told_confidence=replay.start_confidence, told_unfaced=replay.unfaced)
