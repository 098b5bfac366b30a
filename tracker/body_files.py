"""Body models as TOML files: segments with joint axes, superquadric parts, landmarks, search groups."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Literal

import numpy as np
import pydantic

from tracker.arrays import Array, frozen
from tracker.body import BodyModel, Landmark, Parameter, Part
from tracker.errors import ModelError, nearest
from tracker.shape import TaperedSuperquadric

Vector = tuple[float, float, float]


class _Entry(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid", frozen=True)


class _Axis(_Entry):
    """One degree of freedom; `limits_m` makes it a translation, `limits_deg` a rotation."""

    name: str
    axis: Vector
    limits_m: tuple[float, float] | None = None
    limits_deg: tuple[float, float] | None = None


class _Segment(_Entry):
    name: str
    parent: str = "world"
    joint: Vector = (0.0, 0.0, 0.0)
    parameters: tuple[_Axis, ...] = ()


class _Part(_Entry):
    """A tapered superquadric whose z axis runs from `start` to `end`; `radii` are a1 (front) and a2 (side)."""

    name: str
    segment: str
    start: Vector
    end: Vector
    radii: tuple[float, float]
    squareness: tuple[float, float] = (0.5, 1.0)
    taper: tuple[float, float] = (0.0, 0.0)
    front: Vector = (1.0, 0.0, 0.0)


class _Landmark(_Entry):
    segment: str
    at: Vector


class _Model(_Entry):
    name: str
    units: Literal["m"] = "m"
    about: str = ""
    stature_m: float = 0.0
    segments: tuple[_Segment, ...]
    parts: tuple[_Part, ...]
    landmarks: dict[str, _Landmark] = {}
    links: tuple[tuple[str, str], ...] = ()
    groups: dict[str, tuple[str, ...]] = {}


def load_body(path: Path, scale: float = 1.0) -> BodyModel:
    """Reads a body model.

    Args:
        path: a model TOML (see models/gavrila22.toml for a commented one).
        scale: every length is multiplied by it.

    Raises:
        ModelError: the file is missing or wrong; the message names the entry.
    """
    try:
        with path.open("rb") as file:
            content = tomllib.load(file)
        model = _Model.model_validate(content)
    except OSError as error:
        raise ModelError(f"{path}: cannot read the body model: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ModelError(f"{path}: not a TOML file: {error}") from error
    except pydantic.ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(step) for step in first["loc"])
        raise ModelError(f"{path}: {where}: {first['msg']} (see models/gavrila22.toml)") from error
    try:
        return _build(model, scale)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from error


def _build(model: _Model, scale: float) -> BodyModel:
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
            parameters.append(_parameter(axis, scale * np.array(segment.joint), chain, scale))
            chain = len(parameters) - 1
        last[segment.name] = chain
    names = [parameter.name for parameter in parameters]
    if len(set(names)) < len(names):
        raise ModelError(f"parameter {max(names, key=names.count)!r} is defined twice")
    parts = tuple(_part(part, last, scale) for part in model.parts)
    landmarks = tuple(
        Landmark(name, _of_segment(mark.segment, last, name), frozen(scale * np.array(mark.at)))
        for name, mark in model.landmarks.items()
    )
    _check_names(model, names)
    return BodyModel(
        model.name, tuple(parameters), parts, landmarks, model.groups, model.links, scale * model.stature_m
    )


def _check_names(model: _Model, parameters: list[str]) -> None:
    for group, members in model.groups.items():
        for member in members:
            if member not in parameters:
                raise ModelError(f'group "{group}": no parameter "{member}"; {nearest(member, parameters)}')
    for link in model.links:
        for end in link:
            if end not in model.landmarks:
                raise ModelError(f'link {link}: no landmark "{end}"; {nearest(end, model.landmarks)}')


def _parameter(axis: _Axis, joint: Array, parent: int, scale: float) -> Parameter:
    if (axis.limits_m is None) == (axis.limits_deg is None):
        raise ModelError(f'parameter "{axis.name}": give either limits_m (translation) or limits_deg (rotation)')
    if axis.limits_deg is not None:
        low, high = (math.radians(limit) for limit in axis.limits_deg)
    else:
        low, high = (scale * limit for limit in axis.limits_m or (-math.inf, math.inf))
    length = float(np.linalg.norm(axis.axis))
    if length == 0 or not low < high:
        raise ModelError(f'parameter "{axis.name}": axis of length {length:g} or limits out of order')
    direction = frozen(np.array(axis.axis) / length)
    return Parameter(axis.name, axis.limits_deg is not None, direction, frozen(joint), (low, high), parent)


def _of_segment(segment: str, last: dict[str, int], name: str) -> int:
    if segment not in last:
        raise ModelError(f'"{name}": no segment "{segment}"; {nearest(segment, last)}')
    return last[segment]


def _part(part: _Part, last: dict[str, int], scale: float) -> Part:
    start, end = scale * np.array(part.start), scale * np.array(part.end)
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
    radii = scale * np.array(part.radii)
    size = np.array([radii[0], radii[1], length / 2])
    shape = TaperedSuperquadric(size, np.array(part.squareness), np.array(part.taper))
    return Part(part.name, part.segment, _of_segment(part.segment, last, part.name), shape, frozen(placement))
