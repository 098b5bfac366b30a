"""Begins again with a person turned round who may face the other way; the frames decide.

A silhouette looks the same from the front and from behind. Evidence that ten frames do not show accumulates: a woman
whose legs hardly a view shows left over 0.26 turned round in them and 0.29 as she faces; in ninety 7.9 and 6.9 px.
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
"""Frames without doubt below which a person's body is not fitted: a wrong pose makes a body that fits it. If the body
differs from the model's, a fit in spite of that ends the doubts. A way is not better if fewer more of its frames are
without doubt."""

# See docs/lab/facing.md.
_MOST_DOUBTED = 0.5
"""Share of doubtful frames from which on a person who was not found for sure is begun the other way round. For one
woman all are, whichever way she faces; of those turned round 0.43 and 0.91 are doubtful as wholes, of one as she faces
0.68. The left-over length decides, not this share."""

_Reached = TypeVar("_Reached")


def the_better_way_round(
    steps: list[Step],
    reached: _Reached,
    cycle: Cycle,
    whom: Collection[int],
    follow: Callable[[Cycle], tuple[list[Step], _Reached]],
) -> tuple[list[Step], _Reached, Cycle]:
    """The followed frames, or the same frames from the first poses of some persons turned round.

    The latter if it leaves them in less doubt; if neither has frames without doubt, if it leaves over less.

    Args:
        steps: the frames, as followed.
        reached: state behind the last one.
        cycle: their components.
        whom: places in the scene of the persons who may face the other way.
        follow: follows the same frames by another cycle.

    Returns:
        The steps, the state behind them, and the cycle of their beginning.
    """
    for k in whom:
        if any(one.lost for one in steps[0].estimates):
            break
        name = steps[0].scene.persons[k].name
        cycle.progress(f"{name}: tracked once more facing the other way, because hardly a frame is without doubt")
        begun = _begun_turned_round(cycle, steps, k)
        others, other = follow(begun)
        if cycle.leaving():
            break
        if _leave_less(others, steps, k):
            steps, reached, cycle = others, other, begun
    return steps, reached, cycle


def may_face_the_other_way(steps: Sequence[Step], cycle: Cycle) -> list[int]:
    """Places of persons found in the first of some steps, not for sure, and mostly in doubt."""
    start = start_of(steps)
    if start is None or start.given:
        return []
    unsure = [k for k, sure in enumerate(start.sureness) if sure < cycle.loss.sure]
    return [k for k in unsure if len(steps) - n_sure(steps, k) > _MOST_DOUBTED * len(steps)]


def rather_wrong(steps: Iterable[Step]) -> dict[int, float]:
    """Places and confidences of persons whose start, the first one in some steps, is more likely wrong than right."""
    confidence = next((step.start_confidence for step in steps if step.start_confidence), ())
    return {k: right for k, right in enumerate(confidence) if right < RATHER_RIGHT}


def doubtful_in_all(steps: Sequence[Step], whom: Mapping[int, float]) -> list[Step]:
    """The steps, with some persons doubtful as wholes in all of them: nothing has confirmed their start.

    For a woman turned round, with a start of confidence 0.22, only legs were ambiguous in 57 of 100 frames.
    """
    told = list(steps)
    for n, step in enumerate(told):
        estimates = list(step.estimates)
        for k, right in whom.items():
            estimates[k] = estimates[k].doubting((Doubt("", Because.UNSURE_START, right, RATHER_RIGHT),))
        told[n] = replace(step, estimates=tuple(estimates))
    return told


def n_sure(steps: Iterable[Step], person: int) -> int:
    """Frames without doubt about a person."""
    return sum(not (step.estimates[person].lost or doubted(step.estimates[person])) for step in steps)


def _begun_turned_round(cycle: Cycle, steps: Sequence[Step], k: int) -> Cycle:
    """The cycle that starts as some steps did, but with person k turned round; no person is lost in the first step."""
    estimates = list(steps[0].estimates)
    estimates[k] = replace(estimates[k], q=turned_round(steps[0].scene.persons[k].body, estimates[k].q))
    begun = cycle.knowing({steps[0].frame.index: estimates}, start_of(steps), believed=True)
    return replace(begun, before=replace(begun.before, estimates=cycle.before.estimates, refined=cycle.before.refined))


def _leave_less(others: Sequence[Step], steps: Sequence[Step], k: int) -> bool:
    gained = n_sure(others, k) - n_sure(steps, k)
    return gained > 0 if abs(gained) >= LEAST_SEEN else _left(others) < _left(steps)


def _left(steps: Sequence[Step]) -> tuple[int, float]:
    """Number of losses in some steps, and the left-over length of their poses, px."""
    estimates = [one for step in steps for one in step.estimates]
    return sum(one.lost for one in estimates), sum(one.distance_px for one in estimates)
