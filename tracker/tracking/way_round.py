"""Who may face the other way is begun turned round, and what follows decides.

A silhouette seen from the front looks as from behind. What ten frames do not tell accumulates: of a woman whose legs
hardly a view shows 0.26 was left over turned round in them and 0.29 as she faces; in ninety 7.9 and 6.9 px.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from tracker.bodies.limbs import turned_round
from tracker.tracking.cycle import Cycle
from tracker.tracking.doubt import Because, Doubt
from tracker.tracking.found_before import start_of
from tracker.tracking.loss import doubted
from tracker.tracking.start import RATHER_RIGHT
from tracker.tracking.trajectory import Step

# See docs/lab/fit_in_doubt.md.
LEAST_SEEN = 4
"""Frames in which a person is seen without doubt, below which her body is not fitted: a pose that is wrong makes a body
that fits it. If it is the body that is unlike the model's, one fitted all the same ends the doubts. Nor is one of two
ways better that leaves fewer more of them."""

# See docs/lab/facing.md.
_MOST_DOUBTED = 0.5
"""Share of the frames that may be in doubt of somebody who was not found for sure, before he is begun the other way
round. Of one woman all are, whichever way she faces; of those turned round 0.43 and 0.91 are doubtful as wholes, of one
as she faces 0.68. What is left decides, not this."""

_Reached = TypeVar("_Reached")


def the_better_way_round(
    steps: list[Step],
    reached: _Reached,
    cycle: Cycle,
    whom: Collection[int],
    follow: Callable[[Cycle], tuple[list[Step], _Reached]],
) -> tuple[list[Step], _Reached, Cycle]:
    """Frames as they were followed, or as they are followed from the first poses of some persons turned round.

    That if it leaves them in less doubt; where neither way leaves frames without, if it leaves less.

    Args:
        steps: the frames, as followed.
        reached: whatever is behind the last one.
        cycle: the components that they were followed by.
        whom: places in the scene, of those who may face the other way.
        follow: follows the same frames by another cycle.

    Returns:
        The steps, what is behind them, and the cycle that they were begun by.
    """
    for k in whom:
        if any(one.lost for one in steps[0].estimates):
            break
        name = steps[0].scene.persons[k].name
        cycle.progress(f"{name}: tracked once more facing the other way, since hardly a frame is without doubt")
        begun = _begun_turned_round(cycle, steps, k)
        others, other = follow(begun)
        if cycle.leaving():
            break
        if _leave_less(others, steps, k):
            steps, reached, cycle = others, other, begun
    return steps, reached, cycle


def may_face_the_other_way(steps: Sequence[Step], cycle: Cycle) -> list[int]:
    """Places of those who were found in the first of some steps, not for sure, and are mostly in doubt."""
    start = start_of(steps)
    if start is None or start.given:
        return []
    unsure = [k for k, sure in enumerate(start.sureness) if sure < cycle.loss.sure]
    return [k for k in unsure if len(steps) - n_sure(steps, k) > _MOST_DOUBTED * len(steps)]


def rather_wrong(steps: Iterable[Step]) -> dict[int, float]:
    """Places and confidences of those whose start, the first one in some steps, is rather wrong than right."""
    confidence = next((step.start_confidence for step in steps if step.start_confidence), ())
    return {k: right for k, right in enumerate(confidence) if right < RATHER_RIGHT}


def doubtful_in_all(steps: Sequence[Step], whom: Mapping[int, float]) -> list[Step]:
    """The steps, with some persons doubtful as wholes in all of them: nothing has confirmed how they were found.

    Of a woman turned round, with a start of confidence 0.22, legs alone were ambiguous in 57 of 100 frames.
    """
    told = list(steps)
    for n, step in enumerate(told):
        estimates = list(step.estimates)
        for k, right in whom.items():
            estimates[k] = estimates[k].doubting((Doubt("", Because.UNSURE_START, right, RATHER_RIGHT),))
        told[n] = replace(step, estimates=tuple(estimates))
    return told


def n_sure(steps: Iterable[Step], person: int) -> int:
    """Frames in which a person is seen without doubt."""
    return sum(not (step.estimates[person].lost or doubted(step.estimates[person])) for step in steps)


def _begun_turned_round(cycle: Cycle, steps: Sequence[Step], k: int) -> Cycle:
    """The cycle, which starts as some steps did, but with person k turned round; nobody is lost in the first step."""
    estimates = list(steps[0].estimates)
    estimates[k] = replace(estimates[k], q=turned_round(steps[0].scene.persons[k].body, estimates[k].q))
    begun = cycle.knowing({steps[0].frame.index: estimates}, start_of(steps), believed=True)
    return replace(begun, before=replace(begun.before, estimates=cycle.before.estimates, refined=cycle.before.refined))


def _leave_less(others: Sequence[Step], steps: Sequence[Step], k: int) -> bool:
    gained = n_sure(others, k) - n_sure(steps, k)
    return gained > 0 if abs(gained) >= LEAST_SEEN else _left(others) < _left(steps)


def _left(steps: Sequence[Step]) -> tuple[int, float]:
    """How often somebody is lost in some steps, and what the poses leave, px."""
    estimates = [one for step in steps for one in step.estimates]
    return sum(one.lost for one in estimates), sum(one.distance_px for one in estimates)
