"""A second pass: tracks windows of a recording both ways on doubt, and back to frames in which persons come in."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.resources import give_back
from tracker.tracking.coming_in import before_all, steps_of
from tracker.tracking.cycle import Cycle, State
from tracker.tracking.rehearsal import Reopen
from tracker.tracking.sequence import replayed, track
from tracker.tracking.trajectory import Replay, Step
from tracker.tracking.windows import SHORTEST, Pass, after, both_ways, length_of_windows, windows_of


def track_twice(
    frames: Iterator[Frame], scene: Scene, cycle: Cycle, done: Mapping[int, Replay], reopen: Reopen
) -> Iterator[Step]:
    """Tracks all persons through a sequence, and back again on doubt; see `tracker.tracking.sequence.track`.

    Args:
        frames: synchronized images in order.
        scene: the persons (their poses do not matter) and the rig.
        cycle: the components.
        done: frames already tracked by an interrupted run, by number; complete windows are replayed.
        reopen: opens the sequence anew, for rehearsals and later starts of uncertain persons.

    Yields:
        One step a frame, those of a window one after the other; `ready` gives the number that follow at once.

    Raises:
        InitializationError: the first frames show no start pose.
    """
    give_back()
    first = next(frames, None)
    if first is None:
        return
    frames, length = itertools.chain([first], frames), length_of_windows(first)
    if length < SHORTEST:
        yield from track(frames, scene, cycle, done, reopen)
        return
    at, waiting = Pass(scene, State.before(scene), None, 0), list[int]()
    for window, beyond in windows_of(frames, length):
        if window[-1].index < cycle.nobody_before:
            waiting += [frame.index for frame in window]
            continue
        give_back()
        steps, at = _window_tracked(window, beyond, at, cycle, done, reopen)
        provisional, replays = steps[-1].provisional, done
        if any(number not in done for number in waiting):
            replays = {**before_all(steps, at, waiting[0], cycle, reopen), **done}
            provisional |= cycle.leaving()
        together = itertools.chain(steps_of(replays, waiting, scene, cycle, reopen), _given_away(steps))
        for n_left, step in zip(range(len(waiting) + len(steps) - 1, -1, -1), together, strict=True):
            yield replace(step, ready=n_left, provisional=provisional)
        if provisional:
            return
        waiting = []
        del window, beyond, together  # otherwise their images would be held while those of the next window are decoded


def _given_away(steps: list[Step]) -> Iterator[Step]:
    """The steps, each released once it is taken: their images are most of a run's memory."""
    steps.reverse()
    while steps:
        yield steps.pop()


def _window_tracked(
    window: Sequence[Frame],
    beyond: Sequence[Frame],
    begin: Pass,
    cycle: Cycle,
    done: Mapping[int, Replay],
    reopen: Reopen,
) -> tuple[list[Step], Pass]:
    """The steps of a window, with kept frames of an interrupted run, and the state of the pass behind them."""
    n_kept = sum(frame.index in done for frame in window)
    if n_kept == len(window):
        steps = [replayed(frame, begin.scene, cycle, done[frame.index]) for frame in window]
    else:
        found, reached = both_ways(window, beyond, begin, cycle, reopen)
        if not n_kept:
            return found, reached
        steps = _with_kept(found, cycle, done)
    return steps, after(begin, steps, cycle)


def _with_kept(steps: list[Step], cycle: Cycle, done: Mapping[int, Replay]) -> list[Step]:
    """The steps, with kept frames of an interrupted run unchanged.

    An extended run keeps its results, though more frames could improve them now.
    """
    return [
        replayed(step.frame, step.scene, cycle, done[step.frame.index]) if step.frame.index in done else step
        for step in steps
    ]
