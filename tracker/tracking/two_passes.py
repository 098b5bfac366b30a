"""A second pass: windows of a recording are tracked both ways where need be, back to where persons come in, too."""

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
    """Tracks all persons through a sequence, and back again where need be; see `tracker.tracking.sequence.track`.

    Args:
        frames: synchronized images in order.
        scene: the persons (their poses do not matter) and the rig.
        cycle: the components.
        done: frames already tracked by an interrupted run, by number; windows that lack none are replayed.
        reopen: opens the sequence anew, so that uncertain start poses can be rehearsed, and looked for in later frames.

    Yields:
        One step a frame, those of a window one after the other; `ready` says how many follow at once.

    Raises:
        InitializationError: no start pose was found in the first frames.
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
        del window, beyond, together  # or their images would be held while those of the next window are decoded


def _given_away(steps: list[Step]) -> Iterator[Step]:
    """The steps, each no longer held once it is taken: their images are much of what a run holds."""
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
    """The frames of a window, those that an interrupted run has kept as it kept them, and where the pass is then."""
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
    """The steps, those of frames that an interrupted run has kept as it kept them.

    A run that was extended keeps what it had, though more frames could say better now.
    """
    return [
        replayed(step.frame, step.scene, cycle, done[step.frame.index]) if step.frame.index in done else step
        for step in steps
    ]
