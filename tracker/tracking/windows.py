"""Tracks windows of a recording forwards and then back, and weighs the poses of both frame by frame.

The run tracks back a window with doubt in it, and the first frames of a new person, because a pose that is wrong from
the start on may raise no doubt. In these frames the poses of the first pass stay if the way back ends in the same
places. The errors of the two directions hardly coincide: a limb is lost on the way into its hiding place, and not on
the way out of it. See `tracker.tracking.verdict`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from tracker.bodies.limbs import are_apart
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.images.sight import Sight
from tracker.tracking.backwards import told_in_time, tracked_back, turned
from tracker.tracking.clock import Clock
from tracker.tracking.confirmation import doubtful_in_all, n_sure, rather_wrong
from tracker.tracking.cycle import Cycle, State
from tracker.tracking.easier_start import LedBack
from tracker.tracking.jumps import with_jumps
from tracker.tracking.loss import LossRule, doubted
from tracker.tracking.rehearsal import Reopen
from tracker.tracking.sequence import Ahead, Looking, tracked
from tracker.tracking.trajectory import Step

_LONGEST, SHORTEST = 100, 16
"""Frames of a window. Limbs were wrong for 40 frames at most; a longer window takes memory, and makes a run wait."""

_MOST_BYTES = 2**30
"""Limit on images held at a time; if that is less than the shortest window, there is one pass."""

_BEYOND = 4
"""A window is tracked on for one in so many of its frames, so that the way back is settled when it enters."""

# See docs/lab/way_back.md.
_FIRST = 40
"""Frames from a start on that are tracked back without another reason: an arm took 28 to creep into place."""

_ALIKE = 0.5
"""Share of the least distance of other places (`bodies.limbs.apart_m`: 14 cm of a person), up to which the two ways are
alike. With an acquired model a wrong arm was 14.6 cm from the right one at most."""


@dataclass(frozen=True)
class Pass:
    """State of the first pass."""

    scene: Scene
    state: State
    before: Step | None
    n_frames: int
    """Number of frames with a search."""

    back: LedBack | None = None
    unconfirmed: Mapping[int, float] = field(default_factory=dict)
    """Places and confidences of persons who were probably found wrongly, and not seen without doubt since."""


def length_of_windows(first: Frame) -> int:
    """Number of images of this size that may be held at a time."""
    return held_at_most(sum(image.nbytes for image in first.images if image is not None))


def held_at_most(n_bytes: int) -> int:
    """Number of frames that may be held at a time, with images of so many bytes together."""
    return min(_MOST_BYTES // max(n_bytes, 1) * _BEYOND // (_BEYOND + 1), _LONGEST)


def windows_of(frames: Iterator[Frame], length: int) -> Iterator[tuple[Sequence[Frame], Sequence[Frame]]]:
    """The frames in windows, each with some of those that follow it."""
    held: list[Frame] = []
    while True:
        held += itertools.islice(frames, length + length // _BEYOND - len(held))
        if not held:
            return
        yield held[:length], held[length:]
        held = held[length:]


def after(begin: Pass, steps: Sequence[Step], cycle: Cycle) -> Pass:
    """State of a pass after steps from another way."""
    state, before = begin.state, begin.before
    for step in steps:
        sight = Sight(step.frame, cycle.plates, None if before is None else before.model_px)
        state, before = state.after(sight, step, cycle.evidence, cycle.loss), step
    n_looked_in = sum(step.frame.index >= cycle.nobody_before for step in steps)
    still = _unconfirmed(begin, steps)
    return Pass(steps[-1].scene, state, steps[-1], begin.n_frames + n_looked_in, unconfirmed=still)


def there(
    frames: Sequence[Frame], scene: Scene, cycle: Cycle, reopen: Reopen | None = None
) -> tuple[list[Step], State]:
    """Held frames tracked forwards, and the state behind the last one; see `sequence.track`."""
    steps, reached = _forwards(frames, Pass(scene, State.before(scene), None, 0), cycle, reopen)
    return steps, reached.state


def both_ways(
    window: Sequence[Frame], beyond: Sequence[Frame], begin: Pass, cycle: Cycle, reopen: Reopen
) -> tuple[list[Step], Pass]:
    """The frames of a window: tracked on from its beginning, and back after doubt, or after a person was found.

    A request to stop meanwhile gets the results of the first pass so far.

    Returns:
        The steps, and the state of the pass behind them.
    """
    first, reached = _forwards(window, begin, cycle, reopen)
    again: list[Step] | None = None
    # a limb that jumps was wrong before, or is wrong since, though no single frame is in doubt: legs exchanged from the
    # start on fell into place in frame 26
    if not reached.state.nobody_found and any(_in_doubt(step, cycle.loss) for step in with_jumps(first)):
        more, onwards = _forwards(beyond, reached, cycle, reopen)
        again = back([*first, *more], cycle, onwards.state)[: len(first)]
    elif not reached.state.nobody_found and (begun := [n for n, step in enumerate(first) if step.start is not None]):
        # nor need a limb jump: with an acquired model an arm that was before another body from the start on crept into
        # place by frame 28; the way back has it right at once
        n_back = begun[0] + _FIRST
        again = [*back(first[:n_back], cycle, reached.state), *first[n_back:]]
        again = None if cycle.leaving() or _alike(first, again) else again
    if cycle.leaving():
        return [replace(step, provisional=True) for step in first], reached
    found = first if again is None else again
    judged = with_jumps(found, begin.before)
    if again is not None:
        judged = told_in_time(judged, begin.before, first)
    unconfirmed, led = _unconfirmed(begin, judged), reached.back
    if unconfirmed:
        judged = doubtful_in_all(judged, unconfirmed)
    if unconfirmed or found is not first:
        # of kept data: a resumed run has nothing else to learn from
        reached = after(begin, judged, cycle)
    return judged, replace(reached, back=_still_to_tell(led, window[-1]))


def _unconfirmed(begin: Pass, steps: Sequence[Step]) -> dict[int, float]:
    """Places of persons who were probably found wrongly, here or before, and whom no frame since has confirmed."""
    whom = rather_wrong(steps) if begin.state.nobody_found else begin.unconfirmed
    return {k: right for k, right in whom.items() if not n_sure(steps, k)}


def _still_to_tell(back: LedBack | None, last: Frame) -> LedBack | None:
    """The start in a later frame than those of a window, for frames that are tracked on from the window."""
    return None if back is None or back.index <= last.index else replace(back, replays={})


def _alike(steps: Sequence[Step], others: Sequence[Step]) -> bool:
    """Whether all joints are in the same places in both."""
    return all(
        one.lost == other.lost and not are_apart(person.body, one.q, other.q, share=_ALIKE)
        for step, rival in zip(steps, others, strict=True)
        for person, one, other in zip(step.scene.persons, step.estimates, rival.estimates, strict=True)
    )


def _in_doubt(step: Step, loss: LossRule) -> bool:
    unsure = step.start is not None and step.start.least_sureness < loss.sure
    return unsure or any(one.lost or doubted(one) for one in step.estimates)


def _forwards(frames: Sequence[Frame], begin: Pass, cycle: Cycle, reopen: Reopen | None) -> tuple[list[Step], Pass]:
    """Some frames tracked on from the state of the first pass, and the state behind them."""
    at, steps = begin, list[Step]()
    with Ahead(frames, cycle) as ahead:
        while not (steps and cycle.leaving()):
            clock = Clock()
            with clock("waiting"):
                sight = ahead.next(at.before)
            if sight is None:
                break
            cycle.progress(f"forwards: frame {sight.frame.index}, {len(frames) - len(steps)} to go")
            n = at.n_frames + (sight.frame.index >= cycle.nobody_before)
            looking = Looking(n >= cycle.loss.start_within, reopen, at.back)
            step, back = tracked(sight, at.scene, cycle, at.state, looking, clock)
            at = Pass(step.scene, at.state.after(sight, step, cycle.evidence, cycle.loss), step, n, back)
            steps.append(step)
    return steps, at


def back(first: Sequence[Step], cycle: Cycle, state: State) -> list[Step]:
    """The frames of a pass tracked from the last one back to the first, each pose weighed against that of the pass.

    Args:
        first: the pass.
        cycle: the components.
        state: behind its last frame.
    """

    def frames() -> Iterator[Frame]:
        for left, step in zip(range(len(first) - 1, 0, -1), reversed(first[:-1]), strict=True):
            if cycle.leaving():
                return
            cycle.progress(f"back: frame {step.frame.index}, {left} to go")
            yield step.frame

    others = {step.frame.index: step for step in first}
    last, turn_s = first[-1], first[-1].frame.time_s
    return [last, *tracked_back(frames(), last, turned(state, last), cycle, turn_s, others)][::-1]
