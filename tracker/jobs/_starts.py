"""What a run says of the poses that it was given to start from."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from tracker.scene import Scene
from tracker.start import Start
from tracker.trajectory import Step


def telling(steps: Iterable[Step], tell: Callable[[tuple[str, ...]], None]) -> Iterator[Step]:
    """The frames of a run as they come; what is to be said of a start in one of them is told before it."""
    for step in steps:
        if step.start is not None:
            tell(told_of_start(step.start, step.scene))
        yield step


def told_of_start(start: Start, scene: Scene) -> tuple[str, ...]:
    """Persons whose given pose fits the images less well than the same turned round, left and right exchanged.

    Args:
        start: the poses, and what else was tried.
        scene: the persons, in the same order.
    """
    return tuple(
        f"{scene.persons[k].name} may be turned round: of the start pose given {given:.0%} of the contour are left "
        f"over, of the same facing the other way {turned:.0%}; check left and right in its file, or leave it out, and "
        "the person is looked for"
        for k, (given, turned) in start.turned_round.items()
    )
