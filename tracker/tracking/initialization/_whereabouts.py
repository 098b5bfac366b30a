"""Where persons are on the floor whom no plate shows: the pieces that what moves in the views has in common."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.errors import InitializationError
from tracker.tracking.initialization import Stages
from tracker.tracking.initialization._covering import NOTHING, Moved, moved
from tracker.tracking.initialization._foregrounds import foregrounds, segmented
from tracker.tracking.initialization._persons import Found, find_persons, in_order

# The middle of a piece is up to 0.15 m from that of the person, who reaches as far as a stride.
_AROUND_M = 0.8
# Who was lost is not far from where it was seen last: two running strides.
_NEAR_M = 2.0


class Whereabouts(NamedTuple):
    """A circle on the floor."""

    middle: Array
    """(2,) metres."""

    radius_m: float
    """Metres."""

    moved: Moved = NOTHING
    """What of the person has moved, where that is known."""

    partly: bool = False
    """Whether images may cut the person off, and one view show nothing of it."""

    def hold(self, places: Array) -> Array:
        """Those of places (N, 2) on the floor inside."""
        inside: Array = places[np.linalg.norm(places - self.middle, axis=1) < self.radius_m]
        return inside


def last_seen(scene: Scene, k: int, stages: Stages) -> Whereabouts | None:
    """Where person k was seen last, if it was."""
    person = scene.persons[k]
    marks = person.body.landmarks_in_world(person.q)[:, :2]
    return Whereabouts(marks.mean(axis=0), _NEAR_M) if stages.seen_before else None


def whereabouts(frame: Frame, scene: Scene, stages: Stages) -> list[Whereabouts]:
    """Where each person sought is, from what each view shows most of the time, in the order of the scene.

    Who sways in one place is in the backdrops with all but the arms; but where the backdrops do not know what is behind
    somebody, and where somebody differs from them, tells who is where.

    Args:
        frame: the images.
        scene: the persons and the rig.
        stages: with the backdrops, and who is not sought.

    Raises:
        InitializationError: nothing moves in two views, or it shows fewer persons.
    """
    sought = tuple(person for k, person in enumerate(scene.persons) if k not in stages.held)
    if stages.seen_before:
        sought = tuple(replace(person, at=None) for person in sought)
    made = stages.backdrops() or stages.plates
    known = tuple(plate or one for plate, one in zip(stages.plates, made, strict=True))
    masks = foregrounds(frame, known)
    if sum(mask is not None for mask in masks) < 2:
        raise InitializationError(
            f"frame {frame.index}: without background plates {len(sought)} persons are looked for where something "
            'moves in the recording, and in two views nothing does: add `background = "background/{view}.png"` to '
            '[reading], or give the poses by initialization = { use = "given", poses = "start.csv" }'
        )
    held = tuple(scene.persons[k] for k in stages.held)
    found = in_order(find_persons(masks, scene.rig, sought, held), sought, scene.rig, stages.seen_before)
    drawn = segmented(frame, known)
    return [Whereabouts(one.points[:, :2].mean(axis=0), _AROUND_M, _within(one, drawn)) for one in found]


def _within(person: Found, drawn: tuple[Mask | None, ...]) -> Moved:
    """What was drawn (H, W) in the person's own region of each view."""
    pairs = zip(person.regions, drawn, strict=True)
    return moved(tuple(None if own is None or mask is None else own & mask for own, mask in pairs))
