"""What is known of a recording before it is followed through: who stands there is not looked for again."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from tracker.bodies.limbs import are_apart
from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array
from tracker.tracking.estimate import Estimate
from tracker.tracking.loss import doubted
from tracker.tracking.start import Start
from tracker.tracking.trajectory import Step


@dataclass(frozen=True)
class FoundBefore:
    """How persons stand in the first frame, and in those after it, as far as that was found in another way."""

    start: Start | None = None
    """Poses of the first frame, which are not looked for; None where they are."""

    frame: int = -1
    """Number of that frame."""

    believed: bool = False
    """Whether the start is neither rehearsed nor looked for in later frames, however sure it is."""

    estimates: Mapping[int, Sequence[Estimate]] = field(default_factory=dict)
    """Frame -> what was found there for each person, in order; poses tracked forwards are weighed against it."""

    refined: bool = True
    """Whether these poses are refined where nothing doubts them, see `gone_again`; else all are predicted and weighed.
    Found in views that are out of step they keep of it: of delays of 24 and 36 ms 19 and 30 were told."""

    def start_in(self, index: int) -> Start | None:
        """The start of a frame, if it is known."""
        return self.start if index == self.frame else None

    def gone_again(self, scene: Scene, index: int) -> tuple[Array | None, ...]:
        """For each person the pose (dof,) that the way found before leads to from where she is; None where none does.

        What lies between the two ways in the frame before, another body's joints, lies between them here.

        Args:
            scene: the persons in the frame before.
            index: number of the frame.
        """
        here = self.estimates.get(index, ())
        if not (here and self.refined):
            return ()
        before = self.estimates.get(max((k for k in self.estimates if k < index), default=index), here)
        poses: list[Array | None] = []
        for k, person in enumerate(scene.persons):
            sure = not (here[k].lost or doubted(here[k]) or before[k].lost)
            near = sure and not are_apart(person.body, person.q, before[k].q)
            poses.append(person.body.clamped(person.q + here[k].q - before[k].q) if near else None)
        return tuple(poses)


def start_of(steps: Iterable[Step]) -> Start | None:
    """How persons were found in some steps; None if none of these tells."""
    return next((step.start for step in steps if step.start is not None), None)
