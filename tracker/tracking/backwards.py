"""Tracks frames backwards in time, from one with known poses."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from tracker.cameras.frame import Frame
from tracker.images.sight import Sight
from tracker.tracking.clock import Clock
from tracker.tracking.cycle import Cycle, State
from tracker.tracking.cycle_turn import advance
from tracker.tracking.estimate import Status
from tracker.tracking.rehearsal import Reopen
from tracker.tracking.trajectory import History, Replay, Step

_MOST_BYTES = 2**28
"""Limit on images held during the way back; with larger images the recording is decoded several times."""


def frames_before(last: Frame, first: int, reopen: Reopen) -> Iterator[Frame]:
    """The frames before one, the latest first.

    Args:
        last: the frame after them.
        first: number of the last frame of the way back.
        reopen: opens the sequence anew; large images are decoded several times.
    """
    n_bytes = sum(image.nbytes for image in last.images if image is not None)
    at_once = max(_MOST_BYTES // max(n_bytes, 1), 1)
    end = last.index
    while end > first:
        held: list[Frame] = []
        for frame in reopen():
            if frame.index >= end:
                break
            if frame.index >= first:
                held = [*held[-at_once + 1 :], frame] if at_once > 1 else [frame]
        if not held:
            return
        yield from reversed(held)
        end = held[0].index


def tracked_back(
    frames: Iterable[Frame],
    step: Step,
    state: State,
    cycle: Cycle,
    turn_s: float,
    others: Mapping[int, Step] = MappingProxyType({}),
) -> Iterator[Step]:
    """The steps of frames that go back in time.

    Args:
        frames: the latest first.
        step: of the frame after them.
        state: at this frame, see `turned`.
        cycle: the components.
        turn_s: sum of the two times; a frame's time on the way back is this minus its own.
        others: frame -> the result of another way; poses are weighed against it.
    """
    for frame in frames:
        sight = Sight(replace(frame, time_s=turn_s - frame.time_s), cycle.plates, step.model_px)
        other = others.get(frame.index)
        seconds, estimates = ({}, ()) if other is None else (other.seconds, other.estimates)
        step = advance(sight, step.scene, cycle, state, Clock(seconds), estimates)
        state = state.after(sight, step, cycle.evidence, cycle.loss)
        yield replace(step, frame=frame, start=None if other is None else other.start)


def turned(state: State, step: Step) -> State:
    """A state that goes back in time from a step, which is at 0 s then: knowledge stays, histories begin anew.

    Args:
        state: behind the step.
        step: a person lost in it is searched at the last known place.
    """
    known = (None if one.lost else History.start(0.0, one.q) for one in step.estimates)
    return replace(state, histories=tuple(known))


def told_in_time(steps: Sequence[Step], before: Step | None, first: Sequence[Step] = ()) -> list[Step]:
    """Steps, with persons called found anew in the frame after a loss, not in the last one before a loss.

    A way back finds a person anew where he leaves, and follows him to where he comes in.

    Args:
        steps: of both ways, in the order of time.
        before: the step before them.
        first: the same frames by a first pass, which knows who was found for the first time; if empty, a person who was
            never there before was followed back to where he comes in.
    """
    told = list(steps)
    for k in range(len(steps[0].estimates)):
        lost = [before is not None and before.estimates[k].lost, *(step.estimates[k].lost for step in steps), False]
        for n, step in enumerate(steps):
            mine = step.estimates[k]
            status, of_first = mine.status, first[n].estimates[k].status if first else Status.RECOVERED
            if lost[n] and status in (Status.TRACKED, Status.RECOVERED):
                came_in = not first and all(lost[1 : n + 1])
                status = of_first if of_first is Status.BOOTSTRAPPED else Status.RECOVERED
                status = Status.TRACKED if came_in else status
            elif lost[n + 2] and status is Status.RECOVERED:
                status = Status.TRACKED
            others = told[n].estimates
            told[n] = replace(told[n], estimates=(*others[:k], replace(mine, status=status), *others[k + 1 :]))
    return told


def as_replay(step: Step) -> Replay:
    """A step without its images."""
    frame, told = step.frame, (dict(step.seconds), step.overlap, dict(step.untrusted), step.strangers)
    return Replay(frame.index, frame.time_s, step.estimates, *told)
