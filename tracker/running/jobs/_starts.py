"""What a run says of the poses that it starts from."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array
from tracker.tracking.start import Start
from tracker.tracking.trajectory import Step

_APART_M = 0.4
"""Between the middles of two bodies, at least; of poses of one body they are nearer."""

_MOST_LEFT_OVER = 2.0
"""By what factor more than the best one another body may leave over. Of two persons either is left over by the other
one's pose, too: theirs left 1.3 and 1.7 times as much; where one person is alone, and the other "body" a shadow or a
flaw of the plates, 11 and 12 times as much."""


def telling(steps: Iterable[Step], tell: Callable[[tuple[str, ...]], None]) -> Iterator[Step]:
    """The frames of a run as they come; what is to be said of a start in one of them is told before it."""
    for step in steps:
        if step.start is not None:
            tell(told_of_start(step.start, step.scene))
        yield step


def told_of_start(start: Start, scene: Scene) -> tuple[str, ...]:
    """Persons whose given pose fits less well than the same turned round, and those who may be another body there.

    Args:
        start: the poses, and what else was tried.
        scene: the persons, in the same order.
    """
    return (*_turned_round(start, scene), *_elsewhere(start, scene))


def _turned_round(start: Start, scene: Scene) -> tuple[str, ...]:
    """Of poses that were given, left and right exchanged."""
    return tuple(
        f"{scene.persons[k].name} may be turned round: of the start pose given {given:.0%} of the contour are left "
        f"over, of the same facing the other way {turned:.0%}; check left and right in the poses or keypoints that it "
        "is from, or leave them out, and the person is looked for"
        for k, (given, turned) in start.turned_round.items()
    )


def _elsewhere(start: Start, scene: Scene) -> Iterator[str]:
    """Where else bodies stand out that fit a person hardly worse; without plates poses are scattered over the floor."""
    for person, ranking, axes in zip(scene.persons, start.hypotheses, start.evidence, strict=False):
        places: list[Array] = []
        for one in ranking if axes else ():
            if one.left_over > _MOST_LEFT_OVER * ranking[0].left_over:
                continue
            place = person.body.landmarks_in_world(one.q)[:, :2].mean(axis=0)
            if all(np.linalg.norm(place - other) > _APART_M for other in places):
                places.append(place)
        if len(places) > 1:
            first, *others = (f"({x:.1f}, {y:.1f})" for x, y in places)
            yield (
                f"{person.name} may be one of {len(places)} bodies: the model fits best at {first} m, and was tried at "
                f"{', '.join(others)} too; if that is the wrong one say where the person is at the start, for "
                f'instance persons = [{{ name = "{person.name}", at = [{places[1][0]:.1f}, {places[1][1]:.1f}], ... }}]'
            )
