"""What a body model file describes, and the body that is made of it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np
import pydantic

from tracker.arrays import Array, frozen
from tracker.body import BodyModel
from tracker.body_defaults import chains
from tracker.body_facts import keypoint_marks, with_facts
from tracker.body_sections import Clothes, Entry, Joints, KeypointEntry, Movement, SkinSection, StartMarks
from tracker.body_skin import skin_of
from tracker.errors import ModelError, name_fault, nearest
from tracker.mirror import Mirror
from tracker.segments import Landmark, Parameter, Part, Segment
from tracker.shape import TaperedSuperquadric

Vector = tuple[float, float, float]


class AxisEntry(Entry):
    """One degree of freedom; `limits_m` makes it a translation, `limits_deg` a rotation."""

    name: str
    axis: Vector
    limits_m: tuple[float, float] | None = None
    limits_deg: tuple[float, float] | None = None
    usual_deg: float | None = pydantic.Field(default=None, gt=0)
    """How far a rotation is from the rest pose in everyday movement, standard deviation: where images hardly tell, a
    pose is as usual as they allow. None where every angle within the limits is as likely."""

    def scaled(self, factor: float) -> AxisEntry:
        """The axis with the limits of a translation multiplied by a factor."""
        if self.limits_m is None:
            return self
        low, high = self.limits_m
        return self.model_copy(update={"limits_m": (factor * low, factor * high)})


class SegmentEntry(Entry):
    """A rigid segment: its joint in the reference pose, and the parameters that move it, outermost first."""

    name: str
    parent: str = "world"
    joint: Vector = (0.0, 0.0, 0.0)
    parameters: tuple[AxisEntry, ...] = ()


class PartEntry(Entry):
    """A tapered superquadric whose z axis runs from `start` to `end`; `radii` are a1 (front) and a2 (side)."""

    name: str
    segment: str
    start: Vector
    end: Vector
    radii: tuple[float, float]
    squareness: tuple[float, float] = (0.5, 1.0)
    taper: tuple[float, float] = (0.0, 0.0)
    front: Vector = (1.0, 0.0, 0.0)


class LandmarkEntry(Entry):
    """A point on a segment in the reference pose."""

    segment: str
    at: Vector


class BodyDescription(Entry):
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
    landmarks: dict[str, LandmarkEntry] = pydantic.Field(default={})
    links: tuple[tuple[str, str], ...] = ()
    groups: dict[str, tuple[str, ...]] = pydantic.Field(default={})
    start: StartMarks = StartMarks()
    joints: Joints = Joints()
    keypoints: dict[str, KeypointEntry] = pydantic.Field(default={})
    """What 2-D detectors call landmarks, and points beside them; landmarks are keypoints of their own names anyway."""

    clothes: Clothes = Clothes()
    movements: dict[str, Movement] = pydantic.Field(default={})
    skin: SkinSection | None = None
    """The body's own surface; None: its parts are all that is known."""

    sigmas: dict[str, float] = pydantic.Field(default={})
    """Standard deviations of what was measured on the person, metres or plain numbers; empty for a general model."""

    def mirrored(self, name: str) -> str:
        """The name of the other side's segment, part or landmark; the same name on the midline."""
        return Mirror(self.sides, self.across).of(name)

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
        changes = {
            "segments": segments,
            "parts": parts,
            "landmarks": landmarks,
            "stature_m": factor * self.stature_m,
            "keypoints": {name: one.scaled(factor) for name, one in self.keypoints.items()},
            "skin": None if self.skin is None else self.skin.scaled(factor),
            "movements": {name: self._scaled_movement(one, factor) for name, one in self.movements.items()},
        }
        return self.model_copy(update=changes)

    def _scaled_movement(self, movement: Movement, factor: float) -> Movement:
        """The movement with the curves of translations multiplied by a factor."""
        slides = [axis.name for segment in self.segments for axis in segment.parameters if axis.limits_m is not None]
        names = {key for key in movement.curves if Mirror(self.sides).meant(key, slides)}
        return movement.scaled(names, factor)

    def build(self) -> BodyModel:
        """The body that is described.

        Raises:
            ModelError: names, axes or shapes that cannot be.
        """
        return _build(self)


def _build(model: BodyDescription) -> BodyModel:
    if fault := name_fault(model.name):
        raise ModelError(f"name: {fault}")
    parameters, segments = _tree(model.segments)
    names = [parameter.name for parameter in parameters]
    if len(set(names)) < len(names):
        raise ModelError(f"parameter {max(names, key=names.count)!r} is defined twice")
    last = {"world": -1} | {segment.name: segment.end for segment in segments}
    landmarks = tuple(
        Landmark(name, _of_segment(mark.segment, last, name), frozen(mark.at), mark.segment)
        for name, mark in model.landmarks.items()
    )
    _check_names(model, names)
    body = BodyModel(
        name=model.name,
        parameters=tuple(parameters),
        parts=tuple(_part(part, last) for part in model.parts),
        landmarks=landmarks,
        groups=model.groups or chains(segments, tuple(names)),
        links=model.links,
        stature_m=model.stature_m,
        segments=segments,
        mirror=Mirror(model.sides, model.across),
    )
    body = with_facts(body, model.start, model.joints, model.clothes, model.movements)
    body = replace(body, keypoints=keypoint_marks(body, model.keypoints))
    return body if model.skin is None else replace(body, skin=skin_of(body, model.skin))


def _tree(entries: tuple[SegmentEntry, ...]) -> tuple[list[Parameter], tuple[Segment, ...]]:
    """All parameters and segments; parents come before what hangs on them."""
    parameters: list[Parameter] = []
    segments: list[Segment] = []
    place = {"world": -1}
    for entry in entries:
        if entry.parent not in place:
            raise ModelError(
                f'segment "{entry.name}": parent "{entry.parent}" is not defined above it; '
                f"{nearest(entry.parent, place)}"
            )
        if entry.name in place:
            raise ModelError(f'segment "{entry.name}" is defined twice')
        above = place[entry.parent]
        end, first = segments[above].end if above >= 0 else -1, len(parameters)
        for axis in entry.parameters:
            parameters.append(_parameter(axis, np.array(entry.joint), end))
            end = len(parameters) - 1
        place[entry.name] = len(segments)
        own = tuple(range(first, len(parameters)))
        segments.append(Segment(entry.name, above, frozen(entry.joint), own, end))
    return parameters, tuple(segments)


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
    rotates = axis.limits_deg is not None
    if axis.usual_deg is not None and not rotates:
        raise ModelError(f'parameter "{axis.name}": usual_deg is for rotations, and limits_m makes it a translation')
    spread = math.inf if axis.usual_deg is None else math.radians(axis.usual_deg)
    return Parameter(axis.name, rotates, direction, frozen(joint), (low, high), parent, spread)


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
