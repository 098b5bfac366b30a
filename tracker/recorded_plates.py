"""Plates that the recording makes by itself, and whether they show the very persons who are tracked."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import replace

from tracker.cycle import Cycle
from tracker.errors import InitializationError
from tracker.frame import Frame
from tracker.scene import Scene
from tracker.sight import LEAST_COVERED, Sight

log = logging.getLogger("tracker")


def without_persons(cycle: Cycle, scene: Scene, frames: Callable[[], Iterator[Frame]]) -> Cycle:
    """The cycle without plates of the recording's own where they show a person at the start.

    A passer-by makes the views look as if everybody walked about; who sits there all the time is background to them.
    Nobody in the first frame is no fault of theirs.

    Args:
        cycle: the components and plates.
        scene: the persons and the rig.
        frames: opens the recording.
    """
    frame = next(frames(), None) if any(plate is not None and plate.recorded for plate in cycle.plates) else None
    if frame is None:
        return cycle
    try:
        start = cycle.initialization.start(frame, scene, cycle.stages)
    except InitializationError:
        return cycle
    covered = Sight(frame, cycle.plates).covered(cycle.synthesis.silhouettes(scene.with_poses(start.poses)))
    if covered >= LEAST_COVERED:
        return cycle
    log.info("plates of the recording's own are not used: %.0f %% of the persons stand out", 100 * covered)
    return replace(cycle, plates=tuple(None if plate is None or plate.recorded else plate for plate in cycle.plates))
