"""What a body model file describes, and the body that is made of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pydantic

from tracker.bodies.body import BodyModel
from tracker.bodies.body.defaults import bones, chains, marks
from tracker.bodies.body.entries import (
    LandmarkEntry,
    PartEntry,
    SegmentEntry,
    Variation,
    Vector,
    of_segment,
    part_of,
    tree_of,
    with_ground,
)
from tracker.bodies.body.facts import keypoint_marks, rigid_ends, with_facts
from tracker.bodies.body.sections import (
    Clothes,
    Entry,
    Joints,
    Keypoint,
    Movement,
    OrInfinite,
    RigidEnd,
    SkinSection,
    StartMarks,
)
from tracker.bodies.body.skin import skin_of
from tracker.bodies.mirror import Mirror
from tracker.bodies.segments import Landmark
from tracker.foundation.arrays import frozen
from tracker.foundation.errors import ModelError, name_fault, nearest


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
    rigid_ends: dict[str, RigidEnd] = pydantic.Field(default={})
    start: StartMarks = StartMarks()
    joints: Joints = Joints()
    keypoints: dict[str, Keypoint] = pydantic.Field(default={})
    """What 2-D detectors call landmarks, and points beside them; landmarks are keypoints of their own names anyway."""

    clothes: Clothes = Clothes()
    movements: dict[str, Movement] = pydantic.Field(default={})
    skin: SkinSection | None = None
    """The body's own surface; None: its parts are all that is known."""

    sigmas: dict[str, OrInfinite] = pydantic.Field(default={})
    """Standard deviations of what was measured on the person, metres or plain numbers; empty for a general model."""

    variations: tuple[Variation, ...] = ()
    """What is not known of the person's body, which the sigmas of its poses hold; empty for a body that is known."""

    def mirrored(self, name: str) -> str:
        """The name of the other side's segment, part or landmark; the same name on the midline."""
        return Mirror(self.sides, self.across).of(name)

    def with_marks(self) -> BodyDescription:
        """The description with landmarks, and links between them, derived from its shape if it has none."""
        if self.landmarks or not self.parts:
            return self
        found = marks(self.segments, self.parts, Mirror(self.sides, self.across))
        links = self.links or bones(self.segments, self.parts, found)
        return self.model_copy(update={"landmarks": found, "links": links})

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
            "variations": tuple(one.scaled(factor) for one in self.variations),
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
    if not model.segments or not model.parts:
        raise ModelError(f"{'parts' if model.segments else 'segments'}: none, expected at least one")
    parameters, segments = tree_of(model.segments)
    if not parameters:
        raise ModelError("segments: none of them has parameters, expected at least one")
    if not np.linalg.norm(model.across):
        raise ModelError("across: the normal of the plane of symmetry has no length")
    names = [parameter.name for parameter in parameters]
    if len(set(names)) < len(names):
        raise ModelError(f"parameter {max(names, key=names.count)!r} is defined twice")
    own = [part.name for part in model.parts]
    if len(set(own)) < len(own):
        raise ModelError(f"part {max(own, key=own.count)!r} is defined twice")
    last = {"world": -1} | {segment.name: segment.end for segment in segments}
    landmarks = tuple(
        Landmark(name, of_segment(mark.segment, last, name), frozen(mark.at), mark.segment)
        for name, mark in model.landmarks.items()
    )
    _check_names(model, names)
    _check_variations(model)
    body = BodyModel(
        name=model.name,
        parameters=tuple(parameters),
        parts=tuple(part_of(part, last) for part in model.parts),
        landmarks=landmarks,
        groups=model.groups or chains(segments, tuple(names)),
        links=model.links,
        stature_m=model.stature_m,
        segments=with_ground(
            segments, [*(part.segment for part in model.parts), *(mark.segment for mark in landmarks)]
        ),
        mirror=Mirror(model.sides, model.across),
    )
    body = with_facts(body, model.start, model.joints, model.clothes, model.movements)
    ends, keypoints = rigid_ends(body, model.rigid_ends), keypoint_marks(body, model.keypoints)
    body = replace(body, rigid_ends=ends, keypoints=keypoints)
    return body if model.skin is None else replace(body, skin=skin_of(body, model.skin))


def _check_names(model: BodyDescription, parameters: list[str]) -> None:
    for group, members in model.groups.items():
        for member in members:
            if member not in parameters:
                raise ModelError(f'group "{group}": no parameter "{member}"; {nearest(member, parameters)}')
        if not members or len(set(members)) < len(members):
            raise ModelError(f'group "{group}": expected one parameter or more, each once')
    for link in model.links:
        for end in link:
            if end not in model.landmarks:
                raise ModelError(f'link {link}: no landmark "{end}"; {nearest(end, model.landmarks)}')


def _check_variations(model: BodyDescription) -> None:
    n_parts = len(model.parts)
    most = {"joints": len(model.segments), "landmarks": len(model.landmarks)}
    for k, one in enumerate(model.variations):
        for name in Variation.model_fields:
            found, n = len(getattr(one, name)), most.get(name, n_parts)
            if found > n:
                raise ModelError(f"variations[{k}]: {name}: {found} entries, expected at most the model's {n}")
