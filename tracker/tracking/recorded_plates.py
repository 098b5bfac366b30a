"""Plates that the recording makes itself: whether they show the tracked persons, and where."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import replace

import cv2
import numpy as np

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Mask
from tracker.foundation.errors import BackdropError, InitializationError
from tracker.images.operations.masks import grown
from tracker.images.plate import Plate
from tracker.images.sight import LEAST_COVERED, Sight
from tracker.tracking.bootstrapping import first_start
from tracker.tracking.cycle import Cycle, State
from tracker.tracking.found_before import FoundBefore
from tracker.tracking.rehearsal import Reopen
from tracker.tracking.sequence import Looking, tracked
from tracker.tracking.start import Start

log = logging.getLogger("tracker")

_LEAST_VIEWS = 2
"""Least number of views with backdrops: fewer show no depth."""

# See docs/lab/backdrops.md.
_AROUND = 0.03
"""Unknown margin around a person who stays, as a share of the square root of the area: clothes, and misfit of the
model."""


def without_persons(cycle: Cycle, scene: Scene, frames: Callable[[], Iterator[Frame]]) -> Cycle:
    """The cycle without the recording's own plates if they show a person at the start.

    A passer-by makes the views look as if every person walked about; a person who sits there all the time is background
    to them. A first frame without persons is not their fault. If they stay, so does the start that was found before
    them.

    Args:
        cycle: the components and plates.
        scene: the persons and the rig.
        frames: opens the recording.
    """
    frame = next(frames(), None) if any(plate is not None and plate.recorded for plate in cycle.plates) else None
    if frame is None:
        return cycle
    try:
        start = first_start(frame, scene, cycle)
    except BackdropError as fault:
        log.info("plates of the recording's own are not used: %s", fault)
    except InitializationError:
        return cycle
    else:
        covered = Sight(frame, cycle.plates).covered(cycle.synthesis.silhouettes(scene.with_poses(start.poses)))
        if covered >= LEAST_COVERED:
            return replace(cycle, before=FoundBefore(start, frame.index))
        log.info("plates of the recording's own are not used: %.0f %% of the persons stand out", 100 * covered)
    return replace(cycle, plates=tuple(None if plate is None or plate.recorded else plate for plate in cycle.plates))


def behind_who_stays(cycle: Cycle, scene: Scene, reopen: Reopen) -> Cycle:
    """The cycle with plates from the most frequent colours of the views, unknown where persons stay.

    A person who turns or gestures in one place is partly in the backdrops. Where persons are in the first frame, or
    something has come or gone, the backdrops may show them; elsewhere they show the background of arms and legs.
    Without them a turn in three views was lost: 94 mm, a joint off in 55 of 100 frames.

    Args:
        cycle: the components; returned unchanged if persons are not found in the first frame, and without such plates
            if they are in doubt in it.
        scene: the persons and the rig.
        reopen: opens the recording.
    """
    backdrops = cycle.backdrops()
    frame = next(reopen(), None)
    if frame is None or sum(one is not None for one in backdrops) < _LEAST_VIEWS:
        return cycle
    step, led = tracked(Sight(frame), scene, cycle, State.before(scene), Looking(False, reopen))
    models = cycle.synthesis.silhouettes(step.scene)
    sight = Sight(frame, backdrops)
    stand_out = sight.covered(models) >= LEAST_COVERED
    # a person who stands out supports a pose that edges doubt in clutter: martial arts of another person's were 45 mm
    # off without such plates, an arm in 44 of 61 frames
    if any(one.lost for one in step.estimates):
        return cycle
    doubted = any(one.doubtful for one in step.estimates) and not stand_out
    known, start = {frame.index: step.estimates}, step.start
    if led is not None:
        # it was found in another frame
        known = {k: one.estimates for k, one in sorted(led.replays.items())}
        start = Start((), sureness=led.start.sureness)
    plates = tuple(
        None if plate is None or doubted else _unknown_behind(plate, sight, v, model, stand_out)
        for v, (plate, model) in enumerate(zip(backdrops, models, strict=True))
    )
    # in doubt, too: before these plates the start could differ from theirs, and without them the same search would be
    # repeated, which took 200 s
    return replace(cycle, plates=plates).knowing(known, start, believed=True)


def _unknown_behind(plate: Plate, sight: Sight, view: int, model: Mask, stand_out: bool) -> Plate:
    """A view's backdrop, unknown where it may show a person.

    If persons stand out, it shows the places where they do not. If not, another thing may hide a part in the first
    frame, and
    an arm that rests in one place for most of the recording is in the backdrop: it is known where the first frame shows
    the same and no person is. With the first rule alone a woman hidden by a board had a joint off in 9 of 50 frames;
    with the second alone a man who turns was 33 mm off instead of 24.

    Args:
        plate: the backdrop.
        sight: the first frame before it.
        view: number of the view.
        model: (h, w) silhouettes of the persons there.
        stand_out: whether most of them differs from the backdrops.
    """
    changes = sight.changes(view, (0, 0, model.shape[1], model.shape[0]))
    moving = np.zeros_like(model) if changes is None else changes.moving
    doubted = model & ~moving if stand_out else model | moving
    radius = max(2, round(_AROUND * float(np.sqrt(np.count_nonzero(model)))))
    opened = cv2.morphologyEx(doubted.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    unknown = grown(opened.view(np.bool_), radius)
    return replace(plate, unknown=unknown if plate.unknown is None else unknown | plate.unknown, stays=True)
