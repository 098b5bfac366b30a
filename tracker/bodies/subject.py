"""A person in a configuration."""

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
"""Coordinate in metres."""


@component
class Carried:
    """A tapered superquadric that moves with the segment of a landmark, like a part of a model file."""

    name: str
    """Its name; no part of the model has it."""

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
    """As for a model's parts: along and around the axis, 0.1 for a box, 1 for an ellipsoid."""

    taper: tuple[Finite, Finite] = (0.0, 0.0)
    """As for a model's parts."""

    front: Vector = (1.0, 0.0, 0.0)
    """Direction of its depth."""


def with_carried(description: BodyDescription, carried: Sequence[Carried]) -> BodyDescription:
    """A body with carried things.

    Images show the thing with the person, and contours that no part explains draw limbs: with a racket in hand 41 of
    234 frames had a joint 150 mm off, with its two parts none.

    Args:
        description: the body, of the person's size.
        carried: parts of the things.

    Raises:
        ConfigError: the landmark does not exist, the body has the name already, or the body has a skin, which is all
            that is drawn.
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
"""Placeholder of a stature, from `bodytrack init`: no run begins with it."""


Stature = Annotated[float, pydantic.Field(ge=0.04, le=5)]
"""Range of the stature, metres, from the smallest tracked body. Larger values are feet or centimetres; a larger body
has its size in its model file."""

Mass = Annotated[float, pydantic.Field(gt=0, le=500)]
"""Largest mass of a person, kg; larger values are grams or pounds."""


@component
class Subject:
    """A person: a name and a body model."""

    name: str = ""
    """Name of the person in the results; `person1`, `person2`, ... if not given."""

    model: ModelFile = pydantic.Field(default_factory=lambda: model_path("gavrila22").resolve())
    """The body: the name of a bundled model, or a path that ends in .toml."""

    stature_m: Stature | None = None
    """Height that the model is scaled to, metres; None keeps the model's size."""

    mass_kg: Mass | None = None
    """Mass of the person, kg; only the recording `opensim` uses it, to scale the masses of a model."""

    at: tuple[float, float] | None = None
    """Approximate place of the person at the start, x and y in metres: of several bodies before plates, or several
    moving persons, the nearest one is this person. None leaves that to statures, and to the fit of the models. For a
    single person without plates the search still covers the whole floor."""

    carries: tuple[Carried, ...] | None = None
    """Things that the person holds or wears all the time, a racket or a rucksack: they are tracked as parts of the
    body. None: the run finds them, roughly, if it fits the body; `[]` for nothing."""

    shape: Literal["recording", "model"] | None = None
    """`recording`: lengths and shapes are fitted to the first frames before these are tracked; `model`: they are those
    of the model file. None: a model scaled by stature is fitted, because it is not yet that person's; one with a skin
    is not."""

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
            ConfigError: a stature is given, and the model has none of its own; or an entry of `carries` is wrong.
        """
        description = read_description(self.model)
        if self.stature_m is not None:
            if description.stature_m <= 0:
                raise ConfigError(f'person "{self.name}": stature_m given, but {self.model} has none of its own')
            description = description.scaled(self.stature_m / description.stature_m)
        return with_carried(description, self.carries or ())

    def body(self) -> BodyModel:
        """The body model, scaled.

        Raises:
            ModelError: the model file is wrong.
            ConfigError: a stature is given, and the model has none of its own.
        """
        description = self.description()
        try:
            return description.build()
        except ModelError as error:
            raise ModelError(f"{self.model}: {error}") from error
