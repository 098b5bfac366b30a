"""A second pass: windows of a recording are tracked forwards and then back, with the first poses as candidates.

The errors of the two directions hardly coincide: a limb is lost on the way into its hiding, not on the way out of it.
What explains the images better is taken, frame by frame.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from tracker.cycle import Clock, Cycle, State, advance
from tracker.easier_start import LedBack
from tracker.frame import Frame
from tracker.rehearsal import Reopen
from tracker.scene import Scene
from tracker.sight import Sight
from tracker.tracking import Looking, replayed, tracked
from tracker.trajectory import History, Replay, Step

_LONGEST, _SHORTEST = 100, 16
"""Frames of a window. Limbs were wrong for 40 frames at most; a longer window takes memory, and makes a run wait."""

_MOST_BYTES = 2**30
"""Of images held at a time."""

_BEYOND = 4
"""A window is tracked on for one in so many of its frames, so that the way back has found itself when it enters."""


def track_twice(
    frames: Iterator[Frame], scene: Scene, cycle: Cycle, done: Mapping[int, Replay], reopen: Reopen
) -> Iterator[Step]:
    """Tracks all persons through a sequence in both directions; see `tracker.tracking.track`.

    Args:
        frames: synchronized images in order.
        scene: the persons (their poses do not matter) and the rig.
        cycle: the components.
        done: frames already tracked by an interrupted run, by number; windows that lack none are replayed.
        reopen: opens the sequence anew, so that uncertain start poses can be rehearsed, and looked for in later frames.

    Yields:
        One step a frame, those of a window one after the other.

    Raises:
        InitializationError: no start pose was found in the first frames.
    """
    state, before, n_before = State.before(scene), None, 0
    for window, beyond in _windows(frames):
        steps: Iterator[Step]
        if all(frame.index in done for frame in window):
            steps = (replayed(frame, scene, cycle, done[frame.index]) for frame in window)
        else:
            steps = iter(_both_ways((*window, *beyond), scene, cycle, state, n_before, reopen)[: len(window)])
        for step in steps:
            sight = Sight(step.frame, cycle.plates, None if before is None else before.model_px)
            state, scene, before = state.after(sight, step, cycle.evidence), step.scene, step
            yield step
        n_before += len(window)


def _windows(frames: Iterator[Frame]) -> Iterator[tuple[Sequence[Frame], Sequence[Frame]]]:
    """The frames in windows, each with some of those that follow it."""
    held = list(itertools.islice(frames, 1))
    n_bytes = sum(image.nbytes for frame in held for image in frame.images if image is not None)
    most = _MOST_BYTES // max(n_bytes, 1) * _BEYOND // (_BEYOND + 1)
    length = min(max(most, _SHORTEST), _LONGEST)
    while held:
        held += itertools.islice(frames, length + length // _BEYOND - len(held))
        yield held[:length], held[length:]
        held = held[length:]


def _both_ways(
    frames: Sequence[Frame], scene: Scene, cycle: Cycle, state: State, n_before: int, reopen: Reopen
) -> list[Step]:
    """The frames of a window, tracked forwards from a state, n frames into the recording, and then back."""
    first: list[Step] = []
    back: LedBack | None = None
    for n, frame in enumerate(frames, start=n_before + 1):
        cycle.progress(f"first pass: frame {frame.index}")
        sight = Sight(frame, cycle.plates, first[-1].model_px if first else None)
        step, back = tracked(sight, scene, cycle, state, Looking(n >= cycle.loss.start_within, reopen, back))
        state, scene = state.after(sight, step, cycle.evidence), step.scene
        first.append(step)
    return first if state.nobody_found else _back(first, cycle, state)


def _back(first: Sequence[Step], cycle: Cycle, state: State) -> list[Step]:
    """The frames of the first pass from the last one back to the first; the state is that after the first pass."""
    step, end_s = first[-1], first[-1].frame.time_s
    known = (None if one.lost else History.start(0.0, one.q) for one in step.estimates)
    state = replace(state, histories=tuple(known))
    found = [step]
    for there in reversed(first[:-1]):
        cycle.progress(f"second pass: frame {there.frame.index}")
        # predictions are made for a time that goes on
        mirrored = replace(there.frame, time_s=end_s - there.frame.time_s)
        sight = Sight(mirrored, cycle.plates, step.model_px)
        step = advance(sight, step.scene, cycle, state, Clock(there.seconds), [one.q for one in there.estimates])
        state = state.after(sight, step, cycle.evidence)
        found.append(replace(step, frame=there.frame, start=there.start))
    return found[::-1]
