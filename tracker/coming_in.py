"""Persons who come in long after the first frame: those before they are looked for are tracked back from there."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from tracker.backwards import as_replay, frames_before, tracked_back, turned
from tracker.cycle import Cycle, State, unfound
from tracker.jumps import with_jumps
from tracker.rehearsal import Reopen
from tracker.scene import Scene
from tracker.sight import Sight
from tracker.tracking import replayed
from tracker.trajectory import Replay, Step

_GONE_S = 2.0
"""How long everybody is lost, on the way back, when nobody was there before: a way behind a pillar is shorter."""


def before_all(steps: Sequence[Step], state: State, begin: int, cycle: Cycle, reopen: Reopen) -> dict[int, Replay]:
    """The frames before some others, as far back as anybody is there.

    Args:
        steps: the others, tracked.
        state: behind them.
        begin: number of the recording's first frame.
        cycle: the components.
        reopen: opens the sequence anew.

    Returns:
        Frame -> estimates; frames before anybody has come in are not among them.
    """
    found, first = list[Step](), steps[0]
    seen_s = next((step.frame.time_s for step in steps if _anybody(step)), steps[-1].frame.time_s)
    state = replace(turned(state, first), frames_lost=_frames_lost(steps), frames_doubted=(0,) * len(first.estimates))
    frames = frames_before(first.frame, begin, reopen)
    for step in tracked_back(frames, first, state, cycle, first.frame.time_s):
        cycle.progress(f"back to the first frame, {step.frame.index - begin} to go")
        found.append(replace(step, frame=replace(step.frame, images=(), masks=())))  # they would not fit into memory
        if _anybody(step):
            seen_s = step.frame.time_s
        if cycle.leaving() or seen_s - step.frame.time_s >= _GONE_S:
            break
    there = [step for step in found if step.frame.time_s >= seen_s]
    return {step.frame.index: as_replay(step) for step in with_jumps(there[::-1])} if there else {}


def _anybody(step: Step) -> bool:
    return any(not one.lost for one in step.estimates)


def _frames_lost(steps: Sequence[Step]) -> tuple[int, ...]:
    """For each person in how many of the first steps he is lost."""
    ways = zip(*(step.estimates for step in steps), strict=True)
    return tuple(sum(1 for _ in itertools.takewhile(lambda one: one.lost, way)) for way in ways)


def steps_of(
    replays: Mapping[int, Replay], numbers: Sequence[int], scene: Scene, cycle: Cycle, reopen: Reopen
) -> Iterator[Step]:
    """The steps of frames from the recording's first one on; persons are lost in those of which nothing is known.

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
            yield replace(unfound(Sight(frame, cycle.plates), scene, cycle), observed=None)
        else:
            yield replayed(frame, scene, cycle, known)
