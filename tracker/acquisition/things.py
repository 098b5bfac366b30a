"""Things that persons hold or wear and nobody told of: found in frames they were followed in, as parts of bodies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tracker.acquisition.beside import CELL_M, moment
from tracker.acquisition.calibrated_views import Seen, Watching
from tracker.acquisition.moving_along import Moving, most_moving
from tracker.arrays import Array
from tracker.body import BodyModel
from tracker.body_description import BodyDescription
from tracker.body_entries import Vector
from tracker.carried import Carried, with_carried

_N_MOMENTS = 20
"""Frames that are looked at, at most."""

_MOST_THINGS = 3
"""A person carries."""

_PER_DEVIATION = 2.0
"""Half a thing's size over the standard deviation of places in it: 1.7 for a box, 2.2 for an ellipsoid."""


def things_of(
    seen: Sequence[Seen], person: int, description: BodyDescription, watching: Watching
) -> tuple[Carried, ...]:
    """What a person carries, as far as it stands out beside the body and moves with one of its segments.

    Args:
        seen: frames in which the person is, at different poses.
        person: place in their scenes.
        description: the body, fitted to them.
        watching: the cameras, and what is known of their views.
    """
    found: list[Carried] = []
    seen = seen[:: -(-len(seen) // _N_MOMENTS) or 1]
    while len(found) < _MOST_THINGS:
        body = with_carried(description, found).build()
        moments = [moment(_with_body(one, person, body), person, watching) for one in seen]
        moving = most_moving(moments, body)
        if moving is None:
            break
        found.append(_thing(moving, body, f"carried_{len(found) + 1}"))
    return tuple(found)


def _with_body(seen: Seen, person: int, body: BodyModel) -> Seen:
    """The same with another body of a person, at the same pose."""
    poses = tuple(one.q for one in seen.scene.persons)
    return Seen(seen.frame, seen.scene.with_bodies({person: body}).with_poses(poses))


def _thing(moving: Moving, body: BodyModel, name: str) -> Carried:
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


def _vector(values: Array) -> Vector:
    x, y, z = (round(float(value), 3) for value in values)
    return x, y, z


def told_of_things(name: str, things: Sequence[Carried]) -> str:
    """What is said of a person who carries things.

    Args:
        name: the person's.
        things: what was found.
    """
    places = " and ".join(f"{_size_cm(one)} cm large, with the segment of {one.by}" for one in things)
    return f"{name}: something that is no part of the body moves along, {places}"


def entry_of(things: Sequence[Carried]) -> str:
    """The line of a configuration that tells of things; see `tracker.subject.Subject.carries`."""
    return f"carries = [{', '.join(map(_entry, things))}]"


def _size_cm(one: Carried) -> str:
    long_m = float(np.linalg.norm(np.subtract(one.end, one.start)))
    return " x ".join(f"{100 * size_m:.0f}" for size_m in sorted((long_m, *(2 * r for r in one.radii)), reverse=True))


def _entry(one: Carried) -> str:
    numbers = {"start": one.start, "end": one.end, "radii": one.radii, "front": one.front}
    told = ", ".join(f"{key} = [{', '.join(f'{value:g}' for value in values)}]" for key, values in numbers.items())
    return f'{{ name = "{one.name}", by = "{one.by}", {told} }}'
