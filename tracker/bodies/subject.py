"""A person as a configuration describes it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import pydantic

from tracker.bodies.belongings import Carried, with_carried
from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import BodyDescription
from tracker.bodies.body.files import read_description
from tracker.foundation.configuration.components import ModelFile, component
from tracker.foundation.errors import ConfigError, ModelError
from tracker.foundation.resources import model_path

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
