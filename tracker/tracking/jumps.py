"""Limbs that jump from one frame to the next: they are wrong on one side, and the side is unknown.

No limb of 19 true movements at 25 frames a second, including kicks and punches, moved 10 cm in a frame and less than 40
percent of that in the frames before and after (9 cm at most, a hand set down), nor away in one frame and 60 percent of
the way back in the next (1 cm at most). At half the frame rate the former still holds (8 cm), the latter does not (27
cm, the end of a kick); at a third neither holds. One of 29 movements, a backflip with hands that move 56 cm a frame,
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
"""Ratio of a jump to the limb's movement in the neighbouring frames."""

_SHARE = 0.75
"""Least distance of a jump, as a share of that for other places, which two joints must reach: 10 cm of a person."""

# See docs/lab/jumps.md.
_BEND = 1.6
"""Least difference of a limb's step from the mean of those before and after, for a jump within a movement, as a share
of that for other places: 23 cm of a person. A forearm that came out from behind the back as a punch began moved 37 cm,
2.3 times as far as in the next frame, and 12 frames before were wrong without a doubt. Of kicks 20 cm at most."""

_JUMP_S, _LONE_S = 0.1, 0.05
"""Largest time between frames for a jump; for a jump within a movement, and for frames elsewhere between two others,
seconds."""

_MOST_FRAMES = 8
"""Frames in doubt on each side of a jump, for a limb that has moved meanwhile: of limbs that drifted off in hiding and
jumped back, four to eight were more than 15 cm off."""

_STILL_S = 1.0
"""Time in doubt on each side of a jump, for a limb that has kept its place on the body, seconds: it was equally wrong
all the time. A forearm behind the back instead of before the hip stayed so for 9 and for 18 frames."""


def with_jumps(steps: Sequence[Step], before: Step | None = None) -> list[Step]:
    """The steps, with a limb ambiguous around a jump while it differs from the jump's other side.

    Args:
        steps: frames that follow one another, tracked.
        before: the step before them, already judged: a limb may jump from there.

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
    """Frames after which a limb's landmarks (T, L, 3) have jumped; `bend_m` is infinite if frames are far apart."""
    ways, steps = _apart(places[1:], places[:-1]), np.diff(places, axis=0)
    if len(ways) < 3:
        return []
    # The first and the last one have one beside them: the windows of a recording end there. In true movements 2 of 3724
    # steps of limbs are jumps by either side alone, at half the frame rate 12 of 1820; no end of 391 results is one.
    beside = np.maximum(np.append(0.0, ways[:-1]), np.append(ways[1:], 0.0))
    jumps = (ways > least_m) & (ways > _TIMES * beside)
    jumps[[0, -1]] &= np.isfinite(bend_m)
    bent = _apart(steps[1:-1], 0.5 * (steps[:-2] + steps[2:])) > bend_m
    # not out and back, see `_lone`
    over = np.minimum(_apart(places[3:], places[1:-2]), _apart(places[2:-1], places[:-3]))
    jumps[1:-1] |= bent & (ways > beside)[1:-1] & (over > _SHARE * ways[1:-1])
    return [int(n) for n in np.flatnonzero(jumps) if tracked[n : n + 2].all()]


def _elsewhere(places: Array, on_body: Array, held: int, side: range, least_m: float) -> list[int]:
    """Frames on one side of a jump, nearest first, in which a limb differs from the other side.

    Args:
        places: (T, L, 3) of its landmarks in the world, metres.
        on_body: (T, L, 3) the same, with the body as a whole at rest.
        held: the first frame of the other side.
        side: frames of this side.
        least_m: least distance that counts as elsewhere.
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
    """(T,) distance of a limb's landmarks (T, L, 3) from the neighbouring frames', m, if it is elsewhere; or 0."""
    away_m = np.zeros(len(places))
    ways, over = _apart(places[1:], places[:-1]), _apart(places[2:], places[:-2])
    least = np.minimum(ways[:-1], ways[1:])
    alone = (least > least_m) & (least > _TIMES * over) & tracked[:-2] & tracked[1:-1] & tracked[2:]
    away_m[1:-1] = np.where(alone, least, 0.0)
    return away_m


def _apart(one: Array, other: Array) -> Array:
    """(...,) distance of landmarks (..., L, 3) of a limb from others, m: the second farthest.

    The farthest one may be a hand that turns at its wrist, and the images hardly show that. With a limit of 14 cm on
    the mean of the
    two farthest, the hand counted: over all results at hand 132 limbs 10 cm and more off were doubted beside jumps, and
    248 others; with the second farthest 131 and 139.
    """
    gaps = np.sort(np.linalg.norm(one - other, axis=-1), axis=-1)
    second: Array = gaps[..., -2:].min(axis=-1)
    return second
