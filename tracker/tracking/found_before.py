"""Tracking that knows what was found in some frames before: who stands there is not looked for again."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from tracker.bodies.limbs import are_apart
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Array
from tracker.images.plate import Plate
from tracker.tracking.cycle import Cycle
from tracker.tracking.estimate import Estimate
from tracker.tracking.initialization import Initialization, Stages
from tracker.tracking.loss import doubted
from tracker.tracking.start import Start
from tracker.tracking.trajectory import Step


def knowing(
    cycle: Cycle, known: Mapping[int, Sequence[Estimate]], start: Start | None = None, believed: bool = False
) -> Cycle:
    """The cycle, which weighs what was found before in the first frames, and looks for nobody who was found there.

    Unless somebody is in doubt in the first frame.

    Args:
        cycle: the components.
        known: frame -> what was found, in order.
        start: how persons were found, in the first frame or a later one.
        believed: however doubtful.
    """
    first, estimates = next(iter(known.items()))
    cycle = replace(cycle, known=known)
    if any(one.lost or (not believed and doubted(one)) for one in estimates):
        return cycle
    ever = cycle.initialization
    ever = ever.otherwise if isinstance(ever, StartedBefore) else ever
    found = replace(start or Start(()), poses=tuple(one.q for one in estimates))
    # However sure: the way back has come to these poses.
    settled = replace(cycle.loss, rehearse=0, look_ahead_s=(), look_on_s=())
    return replace(cycle, initialization=StartedBefore(found, first, ever), loss=settled)


def gone_again(scene: Scene, cycle: Cycle, index: int) -> tuple[Array | None, ...]:
    """For each person the pose (dof,) that the way found before leads to from where she is; None where none does.

    What lies between the two ways in the frame before, another body's joints, lies between them here.

    Args:
        scene: the persons in the frame before.
        cycle: knows what was found.
        index: number of the frame.
    """
    here = cycle.known.get(index, ())
    if not (here and cycle.refines_known):
        return ()
    before = cycle.known.get(max((k for k in cycle.known if k < index), default=index), here)
    poses: list[Array | None] = []
    for k, person in enumerate(scene.persons):
        sure = not (here[k].lost or doubted(here[k]) or before[k].lost)
        near = sure and not are_apart(person.body, person.q, before[k].q)
        poses.append(person.body.clamped(person.q + here[k].q - before[k].q) if near else None)
    return tuple(poses)


def start_of(steps: Iterable[Step]) -> Start | None:
    """How persons were found in some steps; None if none of these tells."""
    return next((step.start for step in steps if step.start is not None), None)


@dataclass(frozen=True)
class StartedBefore:
    """Starts in one frame as was found before, and in others, or where somebody was seen before it, as ever."""

    found: Start
    frame: int
    otherwise: Initialization

    def check(self, scene: Scene, plates: tuple[Plate | None, ...]) -> str:
        """As that which is used elsewhere; see `tracker.tracking.initialization.Initialization.check`."""
        return self.otherwise.check(scene, plates)

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        """See `tracker.tracking.initialization.Initialization.start`."""
        known = frame.index == self.frame and not (stages.held or stages.seen_before)
        return self.found if known else self.otherwise.start(frame, scene, stages)
