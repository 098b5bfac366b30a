"""Limbs that are somewhere else from one frame to the next: on one side they are wrong, and nobody knows on which.

No limb of 19 true movements at 25 frames a second, kicks and punches among them, went 10 cm in a frame and less than 40
percent of that in the frames before and after (9 cm at most, a hand set down), nor went somewhere in one frame and 60
percent of the way back in the next (1 cm at most). Of every second frame the former holds too (8 cm), not the latter
(27 cm, the end of a kick); of every third one neither. Of 29 movements one, a backflip whose hands go 56 cm a frame,
has a step that differs by 20 cm from the mean of those before and after.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tracker.bodies.limbs import apart_m
from tracker.foundation.arrays import Array, Mask
from tracker.tracking.doubt import Because, Doubt
from tracker.tracking.estimate import Status
from tracker.tracking.trajectory import Step

_TIMES = 2.5
"""How much farther a limb goes in one frame than in those beside it where it jumps, a factor."""

_SHARE = 0.75
"""Of what counts as elsewhere in other places, what does here, where two joints must be: 10 cm of a person."""

# See docs/lab/jumps.md.
_BEND = 1.6
"""By how much the step of a limb that jumps in the midst of a movement differs from the mean of those before and
after, in what counts as elsewhere: 23 cm of a person. A forearm that came out from behind the back as a punch began
went 37 cm, 2.3 times as far as in the next frame, and 12 frames before were silently wrong. Of kicks 20 cm at most."""

_JUMP_S, _LONE_S = 0.1, 0.05
"""Most time between frames that jumps are looked for in; that those in the midst of a movement, and frames elsewhere
between two others, are, seconds."""

_MOST_FRAMES = 8
"""Frames on each side of a jump that are doubted of a limb that has moved meanwhile: of limbs that drifted off in
hiding and jumped back, those more than 15 cm off were four to eight."""

_STILL_S = 1.0
"""Time on each side of a jump that is doubted of a limb which has kept its place on the body, seconds: it was as wrong
all the while. A forearm behind the back instead of before the hip stayed so for 9 and for 18 frames."""


def with_jumps(steps: Sequence[Step], before: Step | None = None) -> list[Step]:
    """The steps, a limb ambiguous around a jump for as long as it is elsewhere than on the jump's other side.

    Args:
        steps: frames that follow one another, tracked.
        before: the one before them, told already: a limb may jump from there.

    Returns:
        Steps without a jump are the same objects.
    """
    if before is not None:
        return with_jumps([before, *steps])[1:]
    changed, times_s = list(steps), np.array([step.frame.time_s for step in steps])
    apart_s = float(np.median(np.abs(np.diff(times_s)))) if len(steps) > 1 else np.inf
    if apart_s > _JUMP_S:
        return changed
    for k, person in enumerate(steps[0].scene.persons):
        body = person.body
        poses = np.array([step.estimates[k].q for step in steps])
        tracked = np.array([step.estimates[k].status is Status.TRACKED for step in steps])
        places, least_m = body.landmarks_in_world(poses), _SHARE * apart_m(body)
        poses[:, body.carrying] = body.rest()[body.carrying]
        on_body = body.landmarks_in_world(poses)
        still = max(_MOST_FRAMES, round(_STILL_S / max(apart_s, 1e-3)))
        for group in body.marked_limbs:
            own, kept = (found[:, body.landmarks_of(group)] for found in (places, on_body))
            bend_m = _BEND * apart_m(body) if apart_s <= _LONE_S else np.inf
            away_m = np.zeros(len(steps))
            for last in _jumps(own, tracked, least_m, bend_m):
                earlier, later = range(last, last - still, -1), range(last + 1, last + 1 + still)
                for held, side in ((last, later), (last + 1, earlier)):
                    there = _elsewhere(own, kept, held, side, least_m)
                    away_m[there] = np.maximum(away_m[there], _apart(own[there], own[held]))
            if apart_s <= _LONE_S:
                away_m = np.maximum(away_m, _lone(own, tracked, least_m))
            for n in np.flatnonzero(away_m):
                estimates = list(changed[n].estimates)
                estimates[k] = estimates[k].doubting((Doubt(group, Because.JUMP, float(away_m[n]), least_m),))
                changed[n] = replace(changed[n], estimates=tuple(estimates))
    return changed


def _jumps(places: Array, tracked: Mask, least_m: float, bend_m: float) -> list[int]:
    """Frames after which a limb's landmarks (T, L, 3) have jumped; `bend_m` is infinite where frames are far apart."""
    ways, steps = _apart(places[1:], places[:-1]), np.diff(places, axis=0)
    if len(ways) < 3:
        return []
    # The first and the last one have one beside them: the windows of a recording end there. Of true movements 2 of 3724
    # steps of limbs are jumps by either side alone, of every second frame 12 of 1820; no end of 391 results is one.
    beside = np.maximum(np.append(0.0, ways[:-1]), np.append(ways[1:], 0.0))
    jumps = (ways > least_m) & (ways > _TIMES * beside)
    jumps[[0, -1]] &= np.isfinite(bend_m)
    bent = _apart(steps[1:-1], 0.5 * (steps[:-2] + steps[2:])) > bend_m
    # not out and back, see `_lone`
    over = np.minimum(_apart(places[3:], places[1:-2]), _apart(places[2:-1], places[:-3]))
    jumps[1:-1] |= bent & (ways > beside)[1:-1] & (over > _SHARE * ways[1:-1])
    return [int(n) for n in np.flatnonzero(jumps) if tracked[n : n + 2].all()]


def _elsewhere(places: Array, on_body: Array, held: int, side: range, least_m: float) -> list[int]:
    """Frames on one side of a jump, nearest first, in which a limb is elsewhere than it is on the other side.

    Args:
        places: (T, L, 3) of its landmarks in the world, metres.
        on_body: (T, L, 3) the same, the body standing still as a whole.
        held: the first frame of the other side.
        side: frames to go through.
        least_m: from how far on it is elsewhere.
    """
    found: list[int] = []
    for n, t in enumerate(side):
        if not 0 <= t < len(places) or _apart(places[t], places[held]) <= least_m:
            break
        if n >= _MOST_FRAMES and _apart(on_body[t], on_body[side[0]]) > least_m:
            break
        found.append(t)
    return found


def _lone(places: Array, tracked: Mask, least_m: float) -> Array:
    """(T,) how far a limb's landmarks (T, L, 3) are from those beside in single frames that are elsewhere, m; or 0."""
    away_m = np.zeros(len(places))
    ways, over = _apart(places[1:], places[:-1]), _apart(places[2:], places[:-2])
    least = np.minimum(ways[:-1], ways[1:])
    alone = (least > least_m) & (least > _TIMES * over) & tracked[:-2] & tracked[1:-1] & tracked[2:]
    away_m[1:-1] = np.where(alone, least, 0.0)
    return away_m


def _apart(one: Array, other: Array) -> Array:
    """(...,) how far landmarks (..., L, 3) of a limb are from others, m: the second farthest.

    The farthest one may be a hand that turns at its wrist, which the images hardly show. With 14 cm of the mean of the
    two farthest, the hand counted: in all results at hand 132 limbs 10 cm and more off were doubted beside jumps, and
    248 others; now 131 and 139.
    """
    gaps = np.sort(np.linalg.norm(one - other, axis=-1), axis=-1)
    second: Array = gaps[..., -2:].min(axis=-1)
    return second
