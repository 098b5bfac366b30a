"""Things that persons hold or wear without an entry: found in followed frames, as parts of bodies."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tracker.acquisition.calibrated_views import Seen, Watching
from tracker.acquisition.cells import CELL_M, How, Moving, most_moving, sight_of, surroundings
from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import BodyDescription
from tracker.bodies.body.entries import Vector
from tracker.bodies.scene import Scene
from tracker.bodies.subject import Carried, with_carried
from tracker.foundation.arrays import Array, Mask

_N_FRAMES = 20
"""Frames that are looked at, at most."""

_MOST_THINGS = 3
"""A person carries."""

_PER_DEVIATION = 2.0
"""Half a thing's size over the standard deviation of places in it: 1.7 for a box, 2.2 for an ellipsoid."""

_MOST_INSIDE = 0.12
"""Share of the axis of a part of the body that may lie inside a thing, mean of the frames. Of rackets, rucksacks and
balls at most 0.04, of skirts 0.19 to 0.78, thighs. Tracked as carried, a skirt made leg by leg of what it hides: of 234
frames four had a knee 15 cm off and none was flagged; without, 23 had, and all but one were flagged."""

_ALONG = np.linspace(-0.8, 0.8, 9)
"""Places on a part's axis, of half its length."""


@dataclass(frozen=True)
class Thing:
    """Something that moves with a segment and is no part of the body."""

    carried: Carried
    around: str = ""
    """A part of the body that lies in it, as a thigh does in a skirt: what it hides nobody sees, and it is not to be
    tracked by. Empty for none."""

    hides: str = ""
    """The same where it came to lie in it while it was tracked: of four skirts, two were found beside the legs."""

    how: How = How.CARRIED
    """Furniture, uncertain things, and the person's own clothes are reported and belong to no body."""


def things_of(seen: Sequence[Seen], person: int, description: BodyDescription, watching: Watching) -> tuple[Thing, ...]:
    """Things that a person carries, if they stand out beside the body and move with one of its segments.

    Furniture that no plate shows is among them, and reported as such.

    Args:
        seen: frames in which the person is, at different poses.
        person: place in their scenes.
        description: the body, fitted to them.
        watching: the cameras, and what is known of their views.
    """
    found: list[Thing] = []
    known: list[Array] = []
    seen = seen[:: -(-len(seen) // _N_FRAMES) or 1]
    poses = np.array([one.scene.persons[person].q for one in seen])
    taken = {part.name for part in description.parts}
    free = (name for n in itertools.count(1) if (name := f"carried_{n}") not in taken)
    while len(found) < _MOST_THINGS:
        body = with_carried(description, _laden(found)).build()
        # made anew each time, for most persons carry nothing: of twenty frames they hold 160 MB
        sights = ((sight_of(one, watching), _with_body(one.scene, person, body)) for one in seen)
        around = [surroundings(sight, scene, person, watching.synthesis) for sight, scene in sights]
        for points in known:
            around = [one.without(points) for one in around]
        moving = most_moving(around, body)
        if moving is None:
            break
        if moving.how is How.CARRIED:
            carried = _carried(moving, body, next(free))
            laden = with_carried(description, [*_laden(found), carried]).build()
            found.append(Thing(carried, _around(laden, poses)))
            continue
        if moving.how is not How.OWN:
            known.append(moving.in_world(around[0]))
        one = _upright(moving.points) if moving.how is How.STANDS else _carried(moving, body, next(free))
        found.append(Thing(one, how=moving.how))
    return tuple(found)


def carried_of(things: Sequence[Thing]) -> tuple[Carried, ...]:
    """Those that may be tracked as parts of the body."""
    return tuple(one.carried for one in things if not one.around and one.how is How.CARRIED)


def _laden(things: Sequence[Thing]) -> list[Carried]:
    """What moves with the body: it is not found again."""
    return [one.carried for one in things if one.how in (How.CARRIED, How.OWN)]


def tracked_with(things: Sequence[Thing], body: BodyModel, poses: Array) -> tuple[Thing, ...]:
    """The things, and what lies in those that are parts of the body at poses (N, dof)."""
    places = {part.name: p for p, part in enumerate(body.parts) if len(poses)}
    shown = ((one, places.get(one.carried.name)) for one in things)
    return tuple(one if place is None else replace(one, hides=_around(body, poses, place)) for one, place in shown)


def _around(body: BodyModel, poses: Array, thing: int = -1) -> str:
    """The part that lies in a thing at poses (N, dof), if one does, and that could not have been drawn to it."""
    placed = body.world_from_part(poses)
    steps = _ALONG[:, None] * body.shapes[:, 2]
    points = placed[:, None, :, :3, 3] + steps[..., None] * placed[:, None, :, :3, 2]
    local = np.einsum("nji,nkpj->nkpi", placed[:, thing, :3, :3], points - placed[:, None, None, thing, :3, 3])
    inside = (np.square(local / body.shapes[thing, :3]).sum(axis=-1) < 1).mean(axis=(0, 1))
    inside[~_is_near_the_trunk(body)] = inside[thing] = 0.0
    most = int(inside.argmax())
    return body.parts[most].name if inside[most] > _MOST_INSIDE else ""


def _is_near_the_trunk(body: BodyModel) -> Mask:
    """(P,) of the trunk, or the first link of a limb: a rucksack draws a forearm into itself, but no thigh."""
    ends = body.part_parameters
    n_moving = body.moves[:, ends].sum(axis=0)
    near = np.ones(len(body.parts), dtype=np.bool_)
    for group in body.limbs:
        own = body.parts_of(group)
        near[own] = n_moving[own] == n_moving[own].min(initial=body.dof)
    return near


def _with_body(scene: Scene, person: int, body: BodyModel) -> Scene:
    """The scene with another body of a person, at the same poses."""
    return scene.with_bodies({person: body}).with_poses(tuple(one.q for one in scene.persons))


def _carried(moving: Moving, body: BodyModel, name: str) -> Carried:
    """A superquadric with the middle and the spread of cells."""
    middle = moving.points.mean(axis=0)
    of_segment = [mark for mark in body.landmarks if mark.parameter == moving.end]
    nearest = min(of_segment, key=lambda mark: float(np.linalg.norm(mark.point - middle)))
    _, spreads, axes = np.linalg.svd(moving.points - middle, full_matrices=False)
    sizes = np.maximum(_PER_DEVIATION * spreads / np.sqrt(len(moving.points)), CELL_M / 2)
    return Carried(
        name=name,
        by=nearest.name,
        start=_vector(middle - nearest.point - sizes[0] * axes[0]),
        end=_vector(middle - nearest.point + sizes[0] * axes[0]),
        radii=(round(float(sizes[2]), 3), round(float(sizes[1]), 3)),
        front=_vector(axes[2]),
    )


def _upright(points: Array) -> Carried:
    """What stands, by its size alone: nobody carries it."""
    wide, deep, high = np.ptp(points, axis=0) + CELL_M
    return Carried(name="furniture", by="", start=(0, 0, 0), end=(0, 0, high), radii=(wide / 2, deep / 2))


def _vector(values: Array) -> Vector:
    x, y, z = (round(float(value), 3) for value in values)
    return x, y, z


def told_of_things(name: str, things: Sequence[Thing]) -> str:
    """Message about a person who carries things.

    Args:
        name: the person's.
        things: what was found.
    """
    places = " and ".join(map(_place, things))
    return f"{name}: something that is no part of the body moves along, {places}"


def told_of_uncarried(name: str, things: Sequence[Thing]) -> tuple[str, ...]:
    """Message about things beside a person that are not carried: furniture, uncertain ones, and the person's own.

    Args:
        name: the person's.
        things: what was found.
    """
    film = "that the plates do not show: film plates with it"
    told = []
    for one in things:
        if one.how is How.STANDS:
            told.append(f"something stands beside {name}, {_size_cm(one.carried)} cm large, {film}")
        if one.how is How.DOUBT:
            told.append(
                f"something is beside {name}, {_size_cm(one.carried)} cm large, {film} if it is furniture; nothing "
                f"moves enough to tell. If {name} carries it, tell of it: {entry_of([one.carried])}"
            )
        if one.how is How.OWN:
            told.append(
                f"something moves along with the segment of {one.carried.by}, {_size_cm(one.carried)} cm large, so "
                f"near to {name} that it is taken for a shoe, hair or clothes. If {name} carries it, tell of it: "
                f"{entry_of([one.carried])}"
            )
    return tuple(told)


def entry_of(things: Sequence[Carried]) -> str:
    """The line of a configuration for things; see `tracker.bodies.subject.Subject.carries`."""
    return f"carries = [{', '.join(map(_entry, things))}]"


def _place(one: Thing) -> str:
    inside = one.around or one.hides
    around = f"around {inside} (a skirt, wide clothes?)" if inside else ""
    where = around if one.around else ", ".join(filter(None, (f"with the segment of {one.carried.by}", around)))
    return f"{_size_cm(one.carried)} cm large, {where}"


def _size_cm(one: Carried) -> str:
    long_m = float(np.linalg.norm(np.subtract(one.end, one.start)))
    return " x ".join(f"{100 * size_m:.0f}" for size_m in sorted((long_m, *(2 * r for r in one.radii)), reverse=True))


def _entry(one: Carried) -> str:
    numbers = {"start": one.start, "end": one.end, "radii": one.radii, "front": one.front}
    told = ", ".join(f"{key} = [{', '.join(f'{value:g}' for value in values)}]" for key, values in numbers.items())
    return f'{{ name = "{one.name}", by = "{one.by}", {told} }}'
