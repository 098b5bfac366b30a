"""The body laid along the axis of the foreground (paper, section 4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.errors import InitializationError, ModelError
from tracker.tracking.initialization import Stages
from tracker.tracking.initialization._foregrounds import foregrounds, segmented
from tracker.tracking.initialization._persons import Found, find_persons, in_order
from tracker.tracking.initialization._stance_search import NOTHING, Moved, Stance, moved, on_floor, posed, turned
from tracker.tracking.initialization._visual_hull import STEP_M, TorsoAxis, shadow

# Bodies with an axis nearer to the vertical stand upright; those of animals lie.
_UPRIGHT = np.cos(np.radians(45.0))
# Voxels below this share of a lying axis' height above the floor are legs, and shadows.
_LEGS = 0.5
_FLOOR_PERCENT = 0.5
_MARGIN_M = 0.03
# Specks beyond the ends of a piece.
_EDGE_PERCENT = 1.0
# Two voxels: a shadow is flat.
_SHADOW_M = 0.08


def has_axis(body: BodyModel) -> bool:
    """Whether a body has landmarks on its long axis, and can be placed and turned."""
    return bool(body.start.head and body.start.base and body.start.turn and len(body.root.columns))


def axis_marks(body: BodyModel) -> Integers:
    """(2,) numbers of the landmarks at the head's end and the other end of the body's axis.

    Raises:
        ModelError: the model file does not name them, and its landmarks do not show them; or its root cannot be placed.
    """
    names = (body.start.head, body.start.base)
    if not has_axis(body):
        raise ModelError(
            f'model "{body.name}": bootstrapping needs two landmarks on the body\'s long axis and a root that moves '
            "along x, y and z and turns about the vertical: give head, base and turn in [start] of the model file, see "
            'models/gavrila22.toml; or give the pose by initialization = { poses = "start.csv" }'
        )
    return np.array([body.landmark_names.index(name) for name in names], dtype=np.int64)


def stands_upright(body: BodyModel) -> bool:
    """Whether the body's axis is vertical in the reference pose; an animal's trunk lies."""
    head, base = body.landmarks_in_world(body.rest())[axis_marks(body)]
    return bool((head - base)[2] > _UPRIGHT * np.linalg.norm(head - base))


def without_legs(found: Found, body: BodyModel, rig: Rig) -> Found:
    """Voxels that show a body's axis: all of an upright one, the part above the legs of an animal.

    Seen from around at 45 degrees to its trunk the visual hull of an animal is as broad as it is long, and the shadows
    of its legs cover more of the images than the legs.
    """
    if stands_upright(body):
        return found
    floor = float(np.percentile(found.points[:, 2], _FLOOR_PERCENT))
    points = found.points[found.points[:, 2] > floor + _LEGS * _axis_height(body)]
    if not len(points):
        return found
    regions = (
        None if region is None else region & shadow(rig, v, points, _MARGIN_M) for v, region in enumerate(found.regions)
    )
    return Found(points, tuple(regions))


def _axis_height(body: BodyModel) -> float:
    """Height of a lying axis above the floor the body stands on in its reference pose, metres."""
    rest = body.rest()
    return float(body.landmarks_in_world(rest)[axis_marks(body), 2].mean()) - _lowest(body, rest)


def _lowest(body: BodyModel, q: Array) -> float:
    """Lowest end of a part, metres."""
    placed = body.world_from_part(q)
    return float((placed[:, 2, 3] - np.abs(placed[:, 2, 2]) * body.shapes[:, 2]).min())


def placements(body: BodyModel, axis: TorsoAxis, points: Array) -> list[Array]:
    """Rest poses (dof,) with the body on an axis; the turn about the vertical is almost unknown.

    Args:
        body: the body.
        axis: from the foreground. It shows the head of a body that stands upright in its model file; for an animal both
            ways are possible. points: (N, 3) voxels of the body without its legs, metres: their middle is the place of
            a lying body.
    """
    if stands_upright(body):
        return [_upright(body, axis)]
    return [_lying(body, sign * axis.direction, points.mean(axis=0)) for sign in (1.0, -1.0)]


def laid_in(body: BodyModel, stances: Sequence[Stance], points: Array, headings: Array) -> Array:
    """Stances (N, dof) in every heading in the middle of a piece of the visual hull, on its lowest point.

    Args:
        body: the body.
        stances: standing, seated, crouching, lying.
        points: (N, 3) voxels, metres.
        headings: (M,) turns about the vertical, rad.
    """
    floor_m = float(np.percentile(points[:, 2], _FLOOR_PERCENT)) - STEP_M / 2
    # The shadow on the floor belongs to the piece.
    above = points[points[:, 2] > floor_m + _SHADOW_M]
    low, high = np.percentile(above if len(above) else points, [_EDGE_PERCENT, 100 - _EDGE_PERCENT], axis=0)
    poses = np.concatenate([turned(body, posed(body, stance), headings) for stance in stances])
    return on_floor(body, poses, np.tile((low + high)[:2] / 2, (len(poses), 1)), floor_m)


def _upright(body: BodyModel, axis: TorsoAxis) -> Array:
    """Head and base on the axis; the turn about it stays as it is."""
    marks = axis_marks(body)
    columns = body.root.columns[body.root.columns != body.index(body.start.turn)]
    rest = body.rest()
    length = float(np.linalg.norm(np.subtract(*body.landmarks_in_world(rest)[marks])))
    targets = np.array([axis.head_top, axis.head_top - length * axis.direction])

    def residual(values: Array) -> Array:
        gap: Array = (body.landmarks_in_world(_with(rest, columns, values))[marks] - targets).ravel()
        return gap

    start = rest[columns]
    start[~body.rotates[columns]] = 0.0
    return body.clamped(_with(rest, columns, least_squares(residual, start).x))


def _lying(body: BodyModel, direction: Array, middle: Array) -> Array:
    """The axis in a direction, the middle of the carried part in a place, left and right equally high."""
    marks, columns = axis_marks(body), body.root.columns
    turn, rest = body.index(body.start.turn), body.rest()
    high = body.world_from_part(rest)[:, 2, 3] > _lowest(body, rest) + _LEGS * _axis_height(body)
    volumes = np.where(high, np.prod(body.shapes[:, :3], axis=1), 0.0)

    def placed(q: Array) -> tuple[Array, Array]:
        head, base = body.landmarks_in_world(q)[marks]
        return (head - base) / np.linalg.norm(head - base), volumes @ body.world_from_part(q)[:, :3, 3] / volumes.sum()

    def residual(values: Array) -> Array:
        q = _with(rest, columns, values)
        along, centre = placed(q)
        roll = body.world_from_parameters(q)[columns[-1], 2, :3] @ np.array(body.mirror.across)
        return np.array([*(along - direction), *(centre - middle), roll])

    along, centre = placed(rest)
    heading = np.arctan2(direction[1], direction[0]) - np.arctan2(along[1], along[0])
    q = rest.copy()
    q[turn] += np.sign(body.parameters[turn].axis[2]) * ((heading + np.pi) % (2 * np.pi) - np.pi)
    q[body.root.shifts] += middle - centre
    return body.clamped(_with(rest, columns, least_squares(residual, q[columns]).x))


def _with(q: Array, columns: Integers, values: Array) -> Array:
    changed = q.copy()
    changed[columns] = values
    return changed


# The middle of a piece is up to 0.15 m from that of the person, who reaches as far as a stride.
_AROUND_M = 0.8
# A lost person is not far from the last known place: two running strides.
_NEAR_M = 2.0


class Whereabouts(NamedTuple):
    """A circle on the floor."""

    middle: Array
    """(2,) metres."""

    radius_m: float
    """Metres."""

    moved: Moved = NOTHING
    """Moved pixels of the person, if known."""

    partly: bool = False
    """Whether images may cut the person off, and one view may show nothing of it."""

    def hold(self, places: Array) -> Array:
        """Places (N, 2) on the floor inside."""
        inside: Array = places[np.linalg.norm(places - self.middle, axis=1) < self.radius_m]
        return inside


def last_seen(scene: Scene, k: int, stages: Stages) -> Whereabouts | None:
    """Last known place of person k, if any."""
    person = scene.persons[k]
    marks = person.body.landmarks_in_world(person.q)[:, :2]
    return Whereabouts(marks.mean(axis=0), _NEAR_M) if stages.seen_before else None


def whereabouts(frame: Frame, scene: Scene, stages: Stages) -> list[Whereabouts]:
    """Place of each person sought, from the most frequent colours of each view, in the order of the scene.

    The backdrops contain all of a person who sways in one place except the arms; but pixels where the backdrops are
    unknown behind a person, and pixels that differ from them, show the places.

    Args:
        frame: the images.
        scene: the persons and the rig.
        stages: with the backdrops, and the persons who are not sought.

    Raises:
        InitializationError: nothing moves in two views, or too few persons move.
    """
    sought = tuple(person for k, person in enumerate(scene.persons) if k not in stages.held)
    if stages.seen_before:
        sought = tuple(replace(person, at=None) for person in sought)
    made = stages.backdrops() or stages.plates
    known = tuple(plate or one for plate, one in zip(stages.plates, made, strict=True))
    masks = foregrounds(frame, known)
    if sum(mask is not None for mask in masks) < 2:
        raise InitializationError(
            f"frame {frame.index}: without background plates the search for {len(sought)} persons needs movement "
            'in two views, and there is none: add `background = "background/{view}.png"` to '
            '[reading], or give the poses by initialization = { use = "given", poses = "start.csv" }'
        )
    held = tuple(scene.persons[k] for k in stages.held)
    found = in_order(find_persons(masks, scene.rig, sought, held), sought, scene.rig, stages.seen_before)
    drawn = segmented(frame, known)
    return [Whereabouts(one.points[:, :2].mean(axis=0), _AROUND_M, _within(one, drawn)) for one in found]


def _within(person: Found, drawn: tuple[Mask | None, ...]) -> Moved:
    """The drawn foreground (H, W) in the person's own region of each view."""
    pairs = zip(person.regions, drawn, strict=True)
    return moved(tuple(None if own is None or mask is None else own & mask for own, mask in pairs))
