"""A person as a configuration describes it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import pydantic

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import BodyDescription, read_description
from tracker.bodies.body.entries import Finite, PartEntry, Vector
from tracker.foundation.configuration.components import ModelFile, component
from tracker.foundation.errors import ConfigError, ModelError, nearest
from tracker.foundation.resources import model_path

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


UNMEASURED = "measure"
"""In place of a stature, as `bodytrack init` writes it: no run begins with it."""


Stature = Annotated[float, pydantic.Field(ge=0.04, le=5)]
"""Height that a model is scaled to, metres, from the smallest body that is tracked. More than this is feet or
centimetres; a body that large has its size in its model file."""

Mass = Annotated[float, pydantic.Field(gt=0, le=500)]
"""Of a person, kg; more than this are grams or pounds."""


@component
class Subject:
    """A person: a name and a body model."""

    name: str = ""
    """What the person is called in the results; `person1`, `person2`, ... if not given."""

    model: ModelFile = pydantic.Field(default_factory=lambda: model_path("gavrila22").resolve())
    """The body: the name of a bundled model, or a path that ends in .toml."""

    stature_m: Stature | None = None
    """Height the model is scaled to, metres; None leaves it as it is."""

    mass_kg: Mass | None = None
    """Of the person; only the recording `opensim` hands it on, to scale the masses of a model by it."""

    at: tuple[float, float] | None = None
    """Where the person is at the start, x and y in metres, roughly: of several bodies before plates, or several persons
    who move, the nearest one is taken. None leaves that to statures, and to how well the models fit. One person alone
    without plates is looked for all over the floor all the same."""

    carries: tuple[Carried, ...] | None = None
    """What the person holds or wears all the time, a racket or a rucksack: it is tracked as parts of the body. None: it
    is found, roughly, where the body is fitted; `[]` for nothing."""

    shape: Literal["recording", "model"] | None = None
    """`recording`: lengths and shapes are fitted to the first frames before these are tracked; `model`: they are those
    of the model file. None: a model that is scaled by stature is fitted, for it is not yet that person's; one with a
    skin is not."""

    @pydantic.field_validator("stature_m", mode="before")
    @classmethod
    def _is_measured(cls, value: Any) -> Any:
        if value == UNMEASURED:
            raise ValueError(
                f'"{UNMEASURED}" stands there until the person is measured: set the height with shoes, in metres, e.g. '
                "stature_m = 1.75"
            )
        return value

    @property
    def is_fitted(self) -> bool:
        """Whether the body is fitted to the recording.

        Raises:
            ModelError: the model file is wrong.
        """
        if self.shape is None:
            return self.stature_m is not None and self.description().skin is None
        return self.shape == "recording"

    def description(self) -> BodyDescription:
        """The content of the model file, scaled, with what the person carries.

        Raises:
            ModelError: the model file is wrong.
            ConfigError: a stature is given for a model that does not tell its own; what is carried is wrong.
        """
        description = read_description(self.model)
        if self.stature_m is not None:
            if description.stature_m <= 0:
                raise ConfigError(f'person "{self.name}": stature_m given, but {self.model} does not tell its own')
            description = description.scaled(self.stature_m / description.stature_m)
        return with_carried(description, self.carries or ())

    def body(self) -> BodyModel:
        """The body model, scaled.

        Raises:
            ModelError: the model file is wrong.
            ConfigError: a stature is given for a model that does not tell its own.
        """
        description = self.description()
        try:
            return description.build()
        except ModelError as error:
            raise ModelError(f"{self.model}: {error}") from error
