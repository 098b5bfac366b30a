"""Earlier knowledge of a recording: no search is made for a person whose place is known."""

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
    """Poses of persons in the first frame, and in those after it, from an earlier way."""

    start: Start | None = None
    """Poses of the first frame, which needs no search; None without them."""

    frame: int = -1
    """Number of that frame."""

    believed: bool = False
    """Whether the start is neither rehearsed nor searched in later frames, however unsure it is."""

    estimates: Mapping[int, Sequence[Estimate]] = field(default_factory=dict)
    """Frame -> earlier results for each person, in order; poses tracked forwards are weighed against them."""

    refined: bool = True
    """Whether these poses are only refined unless in doubt, see `gone_again`; otherwise all are predicted and weighed.
    Poses found in views out of step keep a part of the delay: of delays of 24 and 36 ms 19 and 30 were found."""

    def start_in(self, index: int) -> Start | None:
        """The start of a frame, if it is known."""
        return self.start if index == self.frame else None

    def gone_again(self, scene: Scene, index: int) -> tuple[Array | None, ...]:
        """For each person the pose (dof,) to which the earlier way leads from the present one; None without one.

        The difference of the two ways in the frame before, another body's joints, is kept here.

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
    """Earlier start of the persons in some steps; None if these have none."""
    return next((step.start for step in steps if step.start is not None), None)
