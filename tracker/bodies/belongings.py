"""What a person holds or wears that no body model has: parts of a thing, each on one of the body's segments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import pydantic

from tracker.bodies.body.description import BodyDescription
from tracker.bodies.body.entries import Finite, PartEntry, Vector
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import ConfigError, nearest

Radius = Annotated[float, pydantic.Field(gt=0, allow_inf_nan=False)]
"""Metres."""


@component
class Carried:
    """A tapered superquadric that moves with the segment of a landmark, as a part of a model file does."""

    name: str
    """What it is called; no part of the model has that name."""

    by: str
    """The landmark that it is measured from, for instance `right_wrist`; its segment carries it."""

    start: Vector
    """One end of its z axis, metres from the landmark along the axes of the reference pose: of the bundled models x to
    the front, y to the left, z up, arms and hands hanging. Not scaled with the person."""

    end: Vector
    """The other end."""

    radii: tuple[Radius, Radius]
    """Half its depth and half its width across that axis, metres."""

    squareness: tuple[Finite, Finite] = (0.5, 1.0)
    """As of a model's parts: along and around the axis, 0.1 for a box, 1 for an ellipsoid."""

    taper: tuple[Finite, Finite] = (0.0, 0.0)
    """As of a model's parts."""

    front: Vector = (1.0, 0.0, 0.0)
    """Where its depth points."""


def with_carried(description: BodyDescription, carried: Sequence[Carried]) -> BodyDescription:
    """A body with what it carries.

    Images show the thing with the person, and what no part explains draws limbs: with a racket in hand 41 of 234
    frames had a joint 150 mm off, with its two parts none.

    Args:
        description: the body, of the person's size.
        carried: parts of the things.

    Raises:
        ConfigError: no such landmark, a name that the body has, or a body with a skin, which is all that is drawn.
    """
    if carried and description.skin is not None:
        raise ConfigError(f'carries: the model "{description.name}" has a skin, and is drawn as that alone')
    names = {part.name for part in description.parts}
    added = []
    for one in carried:
        if one.by not in description.landmarks:
            raise ConfigError(f'carries "{one.name}": no landmark "{one.by}"; {nearest(one.by, description.landmarks)}')
        if one.name in names:
            raise ConfigError(f'carries "{one.name}": the model "{description.name}" has a part of that name')
        names.add(one.name)
        mark = description.landmarks[one.by]
        ends = {"start": _from(mark.at, one.start), "end": _from(mark.at, one.end)}
        form = {"radii": one.radii, "squareness": one.squareness, "taper": one.taper, "front": one.front}
        added.append(PartEntry.model_validate({"name": one.name, "segment": mark.segment, **ends, **form}))
    return description.model_copy(update={"parts": (*description.parts, *added)}) if added else description


def _from(place: Vector, way: Vector) -> Vector:
    x, y, z = (a + b for a, b in zip(place, way, strict=True))
    return x, y, z
