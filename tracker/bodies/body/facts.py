"""Completes the sections of a model file: names checked, both sides spelt out, missing entries derived."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from tracker.bodies.body import BodyModel, defaults
from tracker.bodies.body.sections import Clothes, Entry, Joints, KeypointEntry, Movement, RigidEnd, StartMarks
from tracker.bodies.keypoints import plain_name
from tracker.bodies.segments import Landmark, Mirror
from tracker.foundation.arrays import frozen
from tracker.foundation.errors import ModelError, name_fault, nearest

_Section = TypeVar("_Section", bound=Entry)


def with_facts(
    body: BodyModel, start: StartMarks, joints: Joints, clothes: Clothes, movements: dict[str, Movement]
) -> BodyModel:
    """The body with its sections; missing keys are derived from the shape, see `defaults`.

    Raises:
        ModelError: a section names something that the body lacks.
    """
    parameters = _Names(body.mirror, body.names, "parameter")
    marks = _Names(body.mirror, body.landmark_names, "landmark")
    parts = _Names(body.mirror, tuple(part.name for part in body.parts), "part")
    return replace(
        body,
        start=_filled(_start(start, parameters, marks), defaults.start_marks(body)),
        joints=_filled(_joints(joints, marks), defaults.joints(body)),
        clothes=_filled(_clothes(clothes, parts), defaults.clothes(body)),
        movements={name: _movement(name, one, parameters, marks) for name, one in movements.items()}
        or defaults.movements(body),
    )


def rigid_ends(body: BodyModel, entries: Mapping[str, RigidEnd]) -> dict[str, RigidEnd]:
    """The ends without a parameter of their own, with their parts and landmarks spelt out.

    Raises:
        ModelError: a group has the name already, or a part or landmark does not exist.
    """
    marks = _Names(body.mirror, body.landmark_names, "landmark")
    parts = _Names(body.mirror, tuple(part.name for part in body.parts), "part")
    for name in entries:
        if fault := name_fault(name):
            raise ModelError(f"rigid_ends: {fault}")
        if name in body.groups:
            raise ModelError(f"rigid_ends.{name}: a group has this name, and is doubted separately; leave one out")
    return {
        name: RigidEnd(
            parts=parts.each(one.parts, f"rigid_ends.{name}.parts"),
            landmarks=marks.each(one.landmarks, f"rigid_ends.{name}.landmarks"),
        )
        for name, one in entries.items()
    }


def keypoint_marks(body: BodyModel, entries: Mapping[str, KeypointEntry]) -> tuple[Landmark, ...]:
    """The points of 2-D detectors, each on the segment of its landmark.

    If one of a pair is left out, it is the mirror image.

    Raises:
        ModelError: a landmark does not exist.
    """
    spelt: dict[str, str] = {}
    for name in entries:
        if (known := spelt.setdefault(plain_name(name), name)) != name:
            raise ModelError(f'keypoints: "{known}" and "{name}" are one keypoint in two spellings; leave one out')
    found = {name: _beside(body, name, one.landmark, one) for name, one in entries.items()}
    for name, one in entries.items():
        other, landmark = body.mirror.of(plain_name(name)), body.mirror.of(one.landmark)
        if other not in spelt and landmark in body.landmark_names:  # a body may lack the other side's
            found[other] = _beside(body, other, landmark, one, mirrored=True)
    return tuple(found.values())


def _beside(body: BodyModel, name: str, landmark: str, entry: KeypointEntry, mirrored: bool = False) -> Landmark:
    if landmark not in body.landmark_names:
        raise ModelError(f'keypoints.{name}: no landmark "{landmark}"; {nearest(landmark, body.landmark_names)}')
    mark = body.landmarks[body.landmark_names.index(landmark)]
    offset, across = np.array(entry.offset), np.array(body.mirror.across)
    if mirrored:
        offset = offset - 2 * (offset @ across) / (across @ across) * across
    return replace(mark, name=name, point=frozen(mark.point + offset))


@dataclass(frozen=True)
class _Names:
    """The names allowed in a key."""

    mirror: Mirror
    valid: tuple[str, ...]
    kind: str

    def all(self, name: str, where: str) -> list[str]:
        """The names meant by one, of both sides if it leaves out the side."""
        found = self.mirror.meant(name, self.valid)
        if not found:
            raise ModelError(f'{where}: no {self.kind} "{name}"; {nearest(name, self.valid)}')
        return found

    def each(self, names: Iterable[str], where: str) -> tuple[str, ...]:
        """The names meant by several."""
        return tuple(dict.fromkeys(own for name in names for own in self.all(name, where)))

    def one(self, name: str, where: str) -> str:
        """The name itself, which may be empty."""
        if name and name not in self.valid:
            raise ModelError(f'{where}: no {self.kind} "{name}"; {nearest(name, self.valid)}')
        return name

    def abreast(self, names: tuple[str, ...], where: str) -> list[tuple[str, ...]]:
        """Names that belong together, once for each side of the first: the left elbow, shoulder, wrist and the right.

        Names on the midline belong to both sides.
        """
        found = [self.all(name, where) for name in names]
        n = len(found[0])
        if any(len(own) not in (1, n) for own in found):
            raise ModelError(f"{where}: {', '.join(names)} do not have the same sides")
        return [tuple(own[k % len(own)] for own in found) for k in range(n)]


def _filled(given: _Section, derived: _Section) -> _Section:
    """A section with its set keys, and the others derived."""
    missing = set(type(given).model_fields) - given.model_fields_set
    return given.model_copy(update={key: getattr(derived, key) for key in missing})


def _start(section: StartMarks, parameters: _Names, marks: _Names) -> StartMarks:
    changes = {
        "head": marks.one(section.head, "start.head"),
        "base": marks.one(section.base, "start.base"),
        "turn": parameters.one(section.turn, "start.turn"),
        "coarse_deg": {
            own: values
            for name, values in section.coarse_deg.items()
            for own in parameters.all(name, "start.coarse_deg")
        },
        "stances_deg": tuple(
            {own: value for name, value in stance.items() for own in parameters.all(name, "start.stances_deg")}
            for stance in section.stances_deg
        ),
    }
    return _changed(section, changes)


def _joints(section: Joints, marks: _Names) -> Joints:
    hinges = {
        joint: (before, behind)
        for name, ends in section.hinges.items()
        for joint, before, behind in marks.abreast((name, *ends), "joints.hinges")
    }
    middles = {
        joint: (one, other)
        for name, ends in section.middles.items()
        for joint, one, other in marks.abreast((name, *ends), "joints.middles")
    }
    changes = {
        "reported": marks.each(section.reported, "joints.reported"),
        "evaluated": marks.each(section.evaluated, "joints.evaluated"),
        "aliases": {marks.one(name, "joints.aliases"): others for name, others in section.aliases.items()},
        "middles": middles,
        "hinges": hinges,
    }
    return _changed(section, changes)


def _clothes(section: Clothes, parts: _Names) -> Clothes:
    garments = {name: parts.each(worn, f"clothes.garments.{name}") for name, worn in section.garments.items()}
    return _changed(section, {"garments": garments, "hair": parts.each(section.hair, "clothes.hair")})


def _movement(name: str, section: Movement, parameters: _Names, marks: _Names) -> Movement:
    where = f"movements.{name}"
    if fault := name_fault(name):
        raise ModelError(f"movements: {fault}")
    curves = {own: curve for key, curve in section.curves.items() for own in parameters.all(key, f"{where}.curves")}
    return _changed(
        section,
        {
            "planted": marks.each(section.planted, f"{where}.planted"),
            "stepping": marks.each(section.stepping, f"{where}.stepping"),
            "curves": curves,
        },
    )


def _changed(section: _Section, changes: Mapping[str, object]) -> _Section:
    """The section with its set keys changed; they still count as set."""
    return section.model_copy(update={key: value for key, value in changes.items() if key in section.model_fields_set})
