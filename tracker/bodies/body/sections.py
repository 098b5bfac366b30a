"""Sections of a body model file beyond its shape: the start, the judged landmarks, the simulation."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import pydantic

from tracker.foundation.errors import nearest


class Entry(pydantic.BaseModel):
    """A table of a model file. An unknown key is refused with the nearest valid one; so are NaN, inf."""

    model_config = pydantic.ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True)

    @pydantic.model_validator(mode="before")
    @classmethod
    def _known_keys(cls, table: Any) -> Any:
        for key in table if isinstance(table, dict) else ():
            if key not in cls.model_fields:
                raise ValueError(f'unknown key "{key}"; {nearest(str(key), cls.model_fields)}')
        return table


OrInfinite = Annotated[float, pydantic.Field(allow_inf_nan=True)]
"""A number of a model file that may be infinite: the limit of a free parameter."""


class StartMarks(Entry):
    """Facts for a search without a prediction; names of parameters may leave out the word of the side."""

    head: str = ""
    """Landmark at the head's end of the body's long axis; empty if there is none."""

    base: str = ""
    """Landmark at the other end of the axis; empty if there is none."""

    turn: str = ""
    """Parameter of the turn that the axis alone does not show, about the vertical; empty if there is none."""

    coarse_deg: dict[str, tuple[float, ...]] = {}
    """Values of further parameters tried with every turn, each side for itself, degrees."""

    stances_deg: tuple[dict[str, float], ...] = pydantic.Field(default=(), min_length=1)
    """Poses on the floor that a start without background plates tries, both sides alike, degrees."""


class Joints(Entry):
    """Landmarks for judging results; names may leave out the word of the side."""

    reported: tuple[str, ...] = ()
    """Landmarks in tables of joints, in order."""

    evaluated: tuple[str, ...] = ()
    """Landmarks that are compared with a reference."""

    aliases: dict[str, tuple[str, ...]] = {}
    """Other names that references give a landmark. Sides are understood also as `l_elbow` and `LElbow`."""

    middles: dict[str, tuple[str, str]] = {}
    """Landmarks that lie midway between two others, for references that lack them."""

    hinges: dict[str, tuple[str, str]] = {}
    """Joints whose flexion is compared, with the landmarks before and behind them: the angle between the two bones."""

    def chains(self) -> dict[str, tuple[str, str, str]]:
        """Hinge -> the three landmarks whose angle is its flexion."""
        return {joint: (before, joint, behind) for joint, (before, behind) in self.hinges.items()}


class RigidEnd(Entry):
    """An end of the body without a parameter of its own, still doubted separately: a stiff head."""

    parts: tuple[str, ...] = pydantic.Field(min_length=1)
    """Its parts; their contours show whether it is in place."""

    landmarks: tuple[str, ...] = ()
    """Landmarks that are in doubt with it."""


class Clothes(Entry):
    """Clothes of a simulated body; names of parts may leave out the word of the side, other parts are skin."""

    garments: dict[str, tuple[str, ...]] = {}
    """Garment -> parts that share its colour."""

    hair: tuple[str, ...] = ()
    """Parts whose upper and rear surface is hair."""


class KeypointEntry(Entry):
    """A point of 2-D detectors on the body: a landmark, or a point beside one on the same segment."""

    landmark: str
    """The landmark that it is, or lies beside."""

    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """From the landmark, metres along the axes of the reference pose; it turns with the landmark's segment."""

    def scaled(self, factor: float) -> KeypointEntry:
        """The entry with its offset multiplied by a factor."""
        x, y, z = self.offset
        return self.model_copy(update={"offset": (factor * x, factor * y, factor * z)})


def _keypoint(entry: Any) -> Any:
    """A landmark's name alone as a table."""
    return {"landmark": entry} if isinstance(entry, str) else entry


Keypoint = Annotated[KeypointEntry, pydantic.BeforeValidator(_keypoint, json_schema_input_type=str | KeypointEntry)]
"""An entry, or only the name of its landmark."""


class SkinSection(Entry):
    """The body's own surface, measured in some pose: refines the result of superquadrics."""

    surface: str
    """PLY or OBJ file of triangles, metres, in the body's model frame; a path relative to the model file. Open patches
    may lie beside or over one another."""

    weights: str = ""
    """Archive of numpy (.npz): `segments`, names of parts, and `weights` (N, S) of all vertices or their `label` (N,);
    empty if the groups of an OBJ file have the names of the parts."""

    smooth: bool = True
    """Blend the motions of several parts (linear blend skinning); false moves every vertex with its strongest part."""

    scale: float = pydantic.Field(default=1.0, gt=0)
    """Factor of the surface's lengths."""

    pose_deg: dict[str, float] = {}
    """Parameters that were not zero in the measurement, degrees; names may leave out the side."""

    def scaled(self, factor: float) -> SkinSection:
        """The section with every length multiplied by a factor."""
        return self.model_copy(update={"scale": factor * self.scale})

    def beside(self, folder: Path) -> SkinSection:
        """The section with paths that start in a folder made absolute."""
        files = {name: str((folder / path).resolve()) for name, path in self.files().items()}
        return self.model_copy(update=files)

    def files(self) -> dict[str, str]:
        """Key -> file, of the given ones."""
        return {name: path for name, path in (("surface", self.surface), ("weights", self.weights)) if path}


_KINDS: dict[str, tuple[str, ...]] = {
    "at": (),
    "ease": ("from_s", "to_s"),
    "swing": ("period_s", "phase"),
    "lift": ("period_s", "phase", "power"),
    "dip": ("period_s",),
    "pace": ("from_s", "run_up_s"),
}
_OPTIONAL = ("phase", "power")


class Term(Entry):
    """A part of a curve over time: one amount in degrees or metres, and its times.

    `at` is a constant; `ease` is added from `from_s` to `to_s` with minimum jerk and stays; `swing` is a sine that
    fades in over half a second; `lift` the positive half of such a sine, to a `power`; `dip` goes there and back
    within each period; `pace` grows by the amount every second, from `from_s` on, after a run-up.
    """

    at: float | None = None
    ease: float | None = None
    swing: float | None = None
    lift: float | None = None
    dip: float | None = None
    pace: float | None = None
    from_s: float = 0.0
    to_s: float = 0.0
    period_s: float = pydantic.Field(default=1.0, gt=0)
    phase: float = 0.0
    """Phase lead, share of the period."""

    power: float = pydantic.Field(default=1.0, gt=0)
    run_up_s: float = pydantic.Field(default=0.25, gt=0)

    @property
    def kind(self) -> str:
        """The key of the given amount."""
        return next(kind for kind in _KINDS if getattr(self, kind) is not None)

    @property
    def amount(self) -> float:
        """The amount, degrees or metres (a second, if it is a pace)."""
        return float(getattr(self, self.kind))

    @pydantic.model_validator(mode="after")
    def _one_amount(self) -> Term:
        given = [kind for kind in _KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            raise ValueError(f"a term needs one of {', '.join(_KINDS)}, found {', '.join(given) or 'none'}")
        wanted, timed = _KINDS[given[0]], self.model_fields_set - set(_KINDS)
        for key in sorted(timed - set(wanted)):
            raise ValueError(f'"{key}" has no meaning for {given[0]}; {nearest(key, wanted)}')
        missing = [key for key in wanted if key not in timed and key not in _OPTIONAL]
        if missing or (given[0] == "ease" and self.to_s <= self.from_s):
            raise ValueError(f"{given[0]} needs {' and '.join(missing) or 'to_s after from_s'}")
        return self

    def scaled(self, factor: float) -> Term:
        """The term with its amount multiplied."""
        return self.model_copy(update={self.kind: factor * self.amount})


def _terms(curve: Any) -> Any:
    """A number, or a list of numbers and tables, as a list of tables."""
    entries = curve if isinstance(curve, (list, tuple)) else (curve,)
    return tuple({"at": one} if isinstance(one, (int, float)) else one for one in entries)


Curve = Annotated[
    tuple[Term, ...], pydantic.BeforeValidator(_terms, json_schema_input_type=float | tuple[float | Term, ...])
]
"""Terms that are added up, degrees or metres; a plain number is a constant."""


class Movement(Entry):
    """A movement to simulate; other parameters stay at zero, or at the nearest possible value."""

    about: str = ""
    planted: tuple[str, ...] = ()
    """Landmarks whose middle stays in its place on the floor; without any the root does."""

    stepping: tuple[str, ...] = ()
    """Landmarks that walk: the body moves on so that the lowest one almost stays in place."""

    curves: dict[str, Curve]
    """Parameter -> its course; a name without the word of the side moves both sides alike."""

    def scaled(self, names: set[str], factor: float) -> Movement:
        """The movement with some of its curves multiplied by a factor."""
        curves = {
            name: tuple(term.scaled(factor) for term in curve) if name in names else curve
            for name, curve in self.curves.items()
        }
        return self.model_copy(update={"curves": curves})
