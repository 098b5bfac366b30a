"""Persons who come in long after the first frame: the run tracks the frames before back from there."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from tracker.bodies.scene import Scene
from tracker.images.sight import Sight
from tracker.tracking.backwards import as_replay, frames_before, told_in_time, turned
from tracker.tracking.bootstrapping import unfound
from tracker.tracking.cycle import Cycle
from tracker.tracking.jumps import with_jumps
from tracker.tracking.loss import Troubles
from tracker.tracking.rehearsal import Reopen
from tracker.tracking.sequence import replayed
from tracker.tracking.trajectory import History, Replay, Step
from tracker.tracking.windows import Pass, both_ways, length_of_windows, windows_of

# See docs/lab/coming_in.md.
_GONE_S = 2.0
"""Time without any person, on the way back, that ends it: the way behind a pillar is shorter."""

_LONGEST = 50
"""Frames tracked back at a time: fewer than in other windows, because there may be no person any more."""


def before_all(steps: Sequence[Step], at: Pass, begin: int, cycle: Cycle, reopen: Reopen) -> dict[int, Replay]:
    """The frames before a window, as far back as a person is there: in windows like others, the latest first.

    Args:
        steps: those of the window.
        at: state of the first pass behind them.
        begin: number of the recording's first frame.
        cycle: the components.
        reopen: opens the sequence anew.

    Returns:
        Frame -> estimates; frames before the first person came in are missing.
    """
    first = steps[0]
    turn_s, seen_s = first.frame.time_s, next((step.frame.time_s for step in steps if _anybody(step)), np.inf)
    at, found = _turned(at, steps, cycle), list[Step]()
    # predictions are made for a time that goes on
    frames = (replace(one, time_s=turn_s - one.time_s) for one in frames_before(first.frame, begin, reopen))
    for window, beyond in windows_of(frames, min(length_of_windows(first.frame), _LONGEST)):
        cycle.progress(f"back to the first frame, {window[0].index - begin} to go")
        back, reached = both_ways(window, beyond, at, cycle, reopen)
        at = replace(reached, back=None)
        # all images would not fit into memory
        found += [replace(step, frame=replace(step.frame, images=(), masks=())) for step in back]
        seen_s = next((turn_s - step.frame.time_s for step in reversed(back) if _anybody(step)), seen_s)
        if cycle.leaving() or seen_s - (turn_s - back[-1].frame.time_s) >= _GONE_S:
            break
    # a limb may jump between two windows as well
    in_time = told_in_time([first, *with_jumps(found)][::-1], None)[:-1]
    there = [step for step in in_time if turn_s - step.frame.time_s >= seen_s]
    return {step.frame.index: replace(as_replay(step), time_s=turn_s - step.frame.time_s) for step in there}


def _turned(at: Pass, steps: Sequence[Step], cycle: Cycle) -> Pass:
    """A pass that goes back in time from the first of some steps, after all of them."""
    first = steps[0]
    # followed places are those of the last image: the first image takes them up anew
    at_first = at.state.after(Sight(first.frame, cycle.plates, first.model_px), first, cycle.evidence, cycle.loss)
    ways = zip(*(step.estimates for step in steps), strict=True)
    frames_lost = tuple(sum(1 for _ in itertools.takewhile(lambda one: one.lost, way)) for way in ways)
    losses = zip(frames_lost, first.estimates, strict=True)
    troubles = tuple(Troubles.of_lost(n_frames, one, cycle.loss) for n_frames, one in losses)
    state = replace(turned(at_first, first), troubles=troubles)
    if state.nobody_found:
        # a person lost in this very frame, as in the dark, but found soon after waits at the last known place;
        # otherwise no frame before would be searched
        soon = sum(step.frame.time_s - first.frame.time_s < _GONE_S for step in steps)
        pairs = zip(first.estimates, frames_lost, strict=True)
        waiting = (History.start(0.0, one.q) if n_lost < soon else None for one, n_lost in pairs)
        state = replace(state, histories=tuple(waiting))
    return replace(at, scene=first.scene, state=state, before=replace(first, frame=replace(first.frame, time_s=0.0)))


def _anybody(step: Step) -> bool:
    return any(not one.lost for one in step.estimates)


def steps_of(
    replays: Mapping[int, Replay], numbers: Sequence[int], scene: Scene, cycle: Cycle, reopen: Reopen
) -> Iterator[Step]:
    """The steps of frames from the recording's first one on; persons are lost in frames without estimates.

    Args:
        replays: frame -> estimates.
        numbers: of the frames, in order.
        scene: the persons and the rig.
        cycle: the components.
        reopen: opens the sequence anew.
    """
    for _, frame in zip(numbers, reopen(), strict=False):
        known = replays.get(frame.index)
        if known is None:
            yield unfound(Sight(frame, cycle.plates), scene, cycle)
        else:
            yield replayed(frame, scene, cycle, known)
