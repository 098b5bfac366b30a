"""Segments, parts and landmarks in a body model file, and in a body."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated

import numpy as np
import pydantic

from tracker.bodies.body.sections import Entry, OrInfinite
from tracker.bodies.segments import Parameter, Part, Segment, TaperedSuperquadric
from tracker.foundation.arrays import Array, frozen
from tracker.foundation.errors import ModelError, nearest

Finite = Annotated[float, pydantic.Field(allow_inf_nan=False)]
Vector = tuple[Finite, Finite, Finite]


class AxisEntry(Entry):
    """One degree of freedom; `limits_m` makes it a translation, `limits_deg` a rotation."""

    name: str
    axis: Vector
    limits_m: tuple[OrInfinite, OrInfinite] | None = None
    limits_deg: tuple[OrInfinite, OrInfinite] | None = None
    usual_deg: float | None = pydantic.Field(default=None, gt=0)
    """Standard deviation of a rotation from the rest pose in everyday movement: where images hardly decide, the pose
    stays as usual as they allow. None if every angle within the limits is equally likely."""

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


Pair = tuple[Finite, Finite]


class Variation(Entry):
    """One way in which a person may differ from the model, by one standard deviation; independent of the others.

    Changes of the entries of a model file, in its order: joints of the segments, starts and ends of the parts and
    landmarks in metres, natural logarithms of radii, and the exponents. Entries that the lists lack stay unchanged.
    """

    joints: tuple[Vector, ...] = ()
    starts: tuple[Vector, ...] = ()
    ends: tuple[Vector, ...] = ()
    radii: tuple[Pair, ...] = ()
    squareness: tuple[Pair, ...] = ()
    taper: tuple[Pair, ...] = ()
    landmarks: tuple[Vector, ...] = ()

    def scaled(self, factor: float) -> Variation:
        """The same for a body with every length multiplied by a factor."""

        def times(vectors: tuple[Vector, ...]) -> tuple[Vector, ...]:
            return tuple((factor * x, factor * y, factor * z) for x, y, z in vectors)

        return self.model_copy(
            update={name: times(getattr(self, name)) for name in ("joints", "starts", "ends", "landmarks")}
        )


def tree_of(entries: tuple[SegmentEntry, ...]) -> tuple[list[Parameter], tuple[Segment, ...]]:
    """All parameters and segments; parents come before their children."""
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


def with_ground(segments: tuple[Segment, ...], holders: Iterable[str]) -> tuple[Segment, ...]:
    """The segments, with one more that never moves if anything, as a pedestal, hangs on the world itself.

    Args:
        segments: the tree.
        holders: names of the segments that carry parts and landmarks.
    """
    return (*segments, Segment("world", -1, frozen(np.zeros(3)), (), -1)) if "world" in holders else segments


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


def of_segment(segment: str, last: dict[str, int], name: str) -> int:
    """The last parameter that moves the segment of a part or landmark, -1 for none."""
    if segment not in last:
        raise ModelError(f'"{name}": no segment "{segment}"; {nearest(segment, last)}')
    return last[segment]


def part_of(part: PartEntry, last: dict[str, int]) -> Part:
    """The part of a body that an entry describes."""
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
    try:
        shape = TaperedSuperquadric(size, np.array(part.squareness), np.array(part.taper))
    except ModelError as error:
        raise ModelError(f'part "{part.name}": {error}') from error
    return Part(part.name, part.segment, of_segment(part.segment, last, part.name), shape, frozen(placement))
