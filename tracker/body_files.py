"""Body models as TOML files: segments with joint axes, superquadric parts, landmarks, search groups."""

from __future__ import annotations

import math
import re
import tomllib
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pydantic
import tomli_w

from tracker.arrays import Array, frozen
from tracker.body import BodyModel, Landmark, Parameter, Part
from tracker.errors import ModelError, nearest
from tracker.shape import TaperedSuperquadric

Vector = tuple[float, float, float]


class _Entry(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid", frozen=True)


class AxisEntry(_Entry):
    """One degree of freedom; `limits_m` makes it a translation, `limits_deg` a rotation."""

    name: str
    axis: Vector
    limits_m: tuple[float, float] | None = None
    limits_deg: tuple[float, float] | None = None

    def scaled(self, factor: float) -> AxisEntry:
        """The axis with the limits of a translation multiplied by a factor."""
        if self.limits_m is None:
            return self
        low, high = self.limits_m
        return self.model_copy(update={"limits_m": (factor * low, factor * high)})


class SegmentEntry(_Entry):
    """A rigid segment: its joint in the reference pose, and the parameters that move it, outermost first."""

    name: str
    parent: str = "world"
    joint: Vector = (0.0, 0.0, 0.0)
    parameters: tuple[AxisEntry, ...] = ()


class PartEntry(_Entry):
    """A tapered superquadric whose z axis runs from `start` to `end`; `radii` are a1 (front) and a2 (side)."""

    name: str
    segment: str
    start: Vector
    end: Vector
    radii: tuple[float, float]
    squareness: tuple[float, float] = (0.5, 1.0)
    taper: tuple[float, float] = (0.0, 0.0)
    front: Vector = (1.0, 0.0, 0.0)


class LandmarkEntry(_Entry):
    """A point on a segment in the reference pose."""

    segment: str
    at: Vector


class BodyDescription(_Entry):
    """The content of a body model file, all positions in the reference pose."""

    name: str
    units: Literal["m"] = "m"
    about: str = ""
    stature_m: float = 0.0
    sides: tuple[str, str] = ("left", "right")
    """Words in names that mirror each other: `left_thigh` and `right_thigh` are a pair."""

    across: Vector = (0.0, 1.0, 0.0)
    """Normal of the body's plane of symmetry, which goes through the origin."""

    segments: tuple[SegmentEntry, ...]
    parts: tuple[PartEntry, ...]
    landmarks: dict[str, LandmarkEntry] = {}
    links: tuple[tuple[str, str], ...] = ()
    groups: dict[str, tuple[str, ...]] = {}
    sigmas: dict[str, float] = {}
    """Standard deviations of what was measured on the person, metres or plain numbers; empty for a general model."""

    def mirrored(self, name: str) -> str:
        """The name of the other side's segment, part or landmark; the same name on the midline."""
        one, other = self.sides
        swapped = {one: other, other: one}
        return "_".join(swapped.get(word, word) for word in name.split("_"))

    def scaled(self, factor: float) -> BodyDescription:
        """The body with every length multiplied by a factor."""

        def times(vector: Vector) -> Vector:
            x, y, z = vector
            return factor * x, factor * y, factor * z

        segments = tuple(
            segment.model_copy(
                update={
                    "joint": times(segment.joint),
                    "parameters": tuple(axis.scaled(factor) for axis in segment.parameters),
                }
            )
            for segment in self.segments
        )
        parts = tuple(
            part.model_copy(
                update={
                    "start": times(part.start),
                    "end": times(part.end),
                    "radii": (factor * part.radii[0], factor * part.radii[1]),
                }
            )
            for part in self.parts
        )
        landmarks = {name: mark.model_copy(update={"at": times(mark.at)}) for name, mark in self.landmarks.items()}
        changes = {"segments": segments, "parts": parts, "landmarks": landmarks, "stature_m": factor * self.stature_m}
        return self.model_copy(update=changes)

    def build(self) -> BodyModel:
        """The body that is described.

        Raises:
            ModelError: names, axes or shapes that cannot be.
        """
        return _build(self)


def read_description(path: Path) -> BodyDescription:
    """Reads the content of a model file.

    Raises:
        ModelError: the file is missing or wrong; the message names the entry.
    """
    try:
        with path.open("rb") as file:
            content = tomllib.load(file)
        return BodyDescription.model_validate(content)
    except OSError as error:
        raise ModelError(f"{path}: cannot read the body model: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ModelError(f"{path}: not a TOML file: {error}") from error
    except pydantic.ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(step) for step in first["loc"])
        raise ModelError(f"{path}: {where}: {first['msg']} (see models/gavrila22.toml)") from error


def save_description(description: BodyDescription, path: Path) -> None:
    """Writes a model file; replaced as a whole, so that nothing half-written stays.

    Args:
        description: lengths are written to a hundredth of a millimetre.
        path: file to write; its folder is made.
    """
    content = _rounded(description.model_dump(mode="json", exclude_none=True))
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(path.name + ".part")
    unfinished.write_text(_INNER_ARRAY.sub(_on_one_line, tomli_w.dumps(content)), encoding="utf-8")
    unfinished.replace(path)


# An array without arrays in it, as tomli_w writes it: an entry a line.
_INNER_ARRAY = re.compile(r"\[\n([^\[\]{}]*?),?\n *\]")


def _on_one_line(array: re.Match[str]) -> str:
    return f"[{' '.join(array[1].split())}]"


def _rounded(value: Any) -> Any:
    """Numbers to five digits after the point, in tables and lists."""
    if isinstance(value, float):
        return round(value, 5)
    if isinstance(value, dict):
        return {key: _rounded(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_rounded(entry) for entry in value]
    return value


def load_body(path: Path, scale: float = 1.0) -> BodyModel:
    """Reads a body model.

    Args:
        path: a model TOML (see models/gavrila22.toml for a commented one).
        scale: every length is multiplied by it.

    Raises:
        ModelError: the file is missing or wrong; the message names the entry.
    """
    description = read_description(path)
    try:
        return description.scaled(scale).build()
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from error


def _build(model: BodyDescription) -> BodyModel:
    parameters: list[Parameter] = []
    last = {"world": -1}
    for segment in model.segments:
        if segment.parent not in last:
            raise ModelError(
                f'segment "{segment.name}": parent "{segment.parent}" is not defined above it; '
                f"{nearest(segment.parent, last)}"
            )
        if segment.name in last:
            raise ModelError(f'segment "{segment.name}" is defined twice')
        chain = last[segment.parent]
        for axis in segment.parameters:
            parameters.append(_parameter(axis, np.array(segment.joint), chain))
            chain = len(parameters) - 1
        last[segment.name] = chain
    names = [parameter.name for parameter in parameters]
    if len(set(names)) < len(names):
        raise ModelError(f"parameter {max(names, key=names.count)!r} is defined twice")
    parts = tuple(_part(part, last) for part in model.parts)
    landmarks = tuple(
        Landmark(name, _of_segment(mark.segment, last, name), frozen(mark.at)) for name, mark in model.landmarks.items()
    )
    _check_names(model, names)
    return BodyModel(model.name, tuple(parameters), parts, landmarks, model.groups, model.links, model.stature_m)


def _check_names(model: BodyDescription, parameters: list[str]) -> None:
    for group, members in model.groups.items():
        for member in members:
            if member not in parameters:
                raise ModelError(f'group "{group}": no parameter "{member}"; {nearest(member, parameters)}')
    for link in model.links:
        for end in link:
            if end not in model.landmarks:
                raise ModelError(f'link {link}: no landmark "{end}"; {nearest(end, model.landmarks)}')


def _parameter(axis: AxisEntry, joint: Array, parent: int) -> Parameter:
    if (axis.limits_m is None) == (axis.limits_deg is None):
        raise ModelError(f'parameter "{axis.name}": give either limits_m (translation) or limits_deg (rotation)')
    if axis.limits_deg is not None:
        low, high = (math.radians(limit) for limit in axis.limits_deg)
    else:
        low, high = axis.limits_m or (-math.inf, math.inf)
    length = float(np.linalg.norm(axis.axis))
    if length == 0 or not low < high:
        raise ModelError(f'parameter "{axis.name}": axis of length {length:g} or limits out of order')
    direction = frozen(np.array(axis.axis) / length)
    return Parameter(axis.name, axis.limits_deg is not None, direction, frozen(joint), (low, high), parent)


def _of_segment(segment: str, last: dict[str, int], name: str) -> int:
    if segment not in last:
        raise ModelError(f'"{name}": no segment "{segment}"; {nearest(segment, last)}')
    return last[segment]


def _part(part: PartEntry, last: dict[str, int]) -> Part:
    start, end = np.array(part.start), np.array(part.end)
    length = float(np.linalg.norm(end - start))
    if length == 0:
        raise ModelError(f'part "{part.name}": start and end are the same point')
    long_axis = (end - start) / length
    side = np.cross(long_axis, np.array(part.front))
    if np.linalg.norm(side) < 1e-6:
        raise ModelError(f'part "{part.name}": `front` is parallel to its axis; give another direction')
    side /= np.linalg.norm(side)
    placement = np.eye(4)
    placement[:3, :3] = np.stack([np.cross(side, long_axis), side, long_axis], axis=1)
    placement[:3, 3] = (start + end) / 2
    size = np.array([*part.radii, length / 2])
    shape = TaperedSuperquadric(size, np.array(part.squareness), np.array(part.taper))
    return Part(part.name, part.segment, _of_segment(part.segment, last, part.name), shape, frozen(placement))
