"""Description in a body model file, and the body made from it."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pydantic
import tomli_w

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
from tracker.bodies.segments import Landmark, Mirror
from tracker.bodies.skin import Skin, columns_of, read_rigging, read_surface, rigging_of_groups
from tracker.foundation.arrays import Array, frozen
from tracker.foundation.errors import ModelError, name_fault, nearest
from tracker.foundation.files import write_whole
from tracker.foundation.source_files import toml_of


def skin_of(body: BodyModel, section: SkinSection) -> Skin:
    """The surface of a body, read from its files.

    Raises:
        ModelError: a file is missing or wrong, or names something that the body lacks.
    """
    path = Path(section.surface)
    surface = read_surface(path)
    if section.weights:
        rigging = read_rigging(Path(section.weights), len(surface.points))
    else:
        rigging = rigging_of_groups(surface, path)
    if not section.smooth:
        rigging = rigging.rigid()
    names = tuple(part.name for part in body.parts)
    columns = columns_of(rigging, names, tuple(part.segment for part in body.parts))
    weights = np.zeros((len(surface.points), len(names)))
    for k, column in enumerate(columns.tolist()):
        if column >= 0:
            weights[:, column] += rigging.weights[:, k]
    part_from_rest = np.linalg.inv(body.world_from_part(measured_pose(body, section))).astype(np.float64)
    return Skin(section.scale * surface.points, surface.faces, weights, part_from_rest)


def measured_pose(body: BodyModel, section: SkinSection) -> Array:
    """(dof,) the pose of the measurement, rad and m.

    Raises:
        ModelError: a parameter does not exist, or is a translation.
    """
    q = np.zeros(body.dof)
    for name, degrees in section.pose_deg.items():
        meant = body.mirror.meant(name, body.names)
        if not meant:
            raise ModelError(f'skin.pose_deg: no parameter "{name}"; {nearest(name, body.names)}')
        for own in meant:
            column = body.names.index(own)
            if not body.rotates[column]:
                raise ModelError(f'skin.pose_deg: "{own}" is a translation, expected angles')
            q[column] = np.radians(degrees)
    return q


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
    """Points of 2-D detectors: other names of landmarks, and points beside them; landmarks are keypoints of their own
    names anyway."""

    clothes: Clothes = Clothes()
    movements: dict[str, Movement] = pydantic.Field(default={})
    skin: SkinSection | None = None
    """The body's own surface; None: only its parts are known."""

    sigmas: dict[str, OrInfinite] = pydantic.Field(default={})
    """Standard deviations of measured values of the person, metres or plain numbers; empty for a general model."""

    variations: tuple[Variation, ...] = ()
    """Uncertainty of the person's body, which the sigmas of its poses include; empty for an exact body."""

    def mirrored(self, name: str) -> str:
        """Name of the segment, part or landmark on the other side; the same name on the midline."""
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
        """The body of the description.

        Raises:
            ModelError: impossible names, axes or shapes.
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


# Body models as TOML files.


def read_description(path: Path) -> BodyDescription:
    """Reads the content of a model file, with landmarks derived from the shape if it has none.

    Raises:
        ModelError: the file is missing or wrong; the message names the entry.
    """
    try:
        found = BodyDescription.model_validate(toml_of(path, ModelError, "the body model")).with_marks()
    except pydantic.ValidationError as error:
        raise ModelError(f"{path}: {_first_fault(error)} (see models/gavrila22.toml)") from error
    return found if found.skin is None else found.model_copy(update={"skin": found.skin.beside(path.parent)})


def read_buildable(path: Path) -> BodyDescription:
    """Reads the content of a model file from which a body can be made, whatever its skin.

    Raises:
        ModelError: the file is missing or wrong; the message names the entry.
    """
    description = read_description(path)
    try:
        description.model_copy(update={"skin": None}).build()
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from error
    return description


def _first_fault(error: pydantic.ValidationError) -> str:
    first = error.errors()[0]
    where = ".".join(str(step) for step in first["loc"])
    reason = first["msg"].removeprefix("Value error, ")
    return f"{where}: {reason}" if where else reason


def save_description(description: BodyDescription, path: Path, decimals: int | None = 5) -> None:
    """Writes a model file; replaced as a whole, so that nothing half-written stays.

    Args:
        description: the body.
        path: file to write; its folder is made.
        decimals: digits after the point, 5 for a hundredth of a millimetre; None for all, so that it loads again
            exactly.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if description.skin is not None:
        description = description.model_copy(update={"skin": _with_files_beside(description.skin, path)})
    content = description.model_dump(mode="json", exclude_none=True, exclude_unset=True)
    content = content if decimals is None else _rounded(content, decimals)
    write_whole(path, _INNER_ARRAY.sub(_on_one_line, tomli_w.dumps(content)))


def _with_files_beside(skin: SkinSection, model: Path) -> SkinSection:
    """The section with its files copied beside a model file: models are kept and moved with their skins.

    Raises:
        ModelError: a file cannot be read.
    """
    names = {}
    for key, source in skin.files().items():
        names[key] = f"{model.stem}_skin{Path(source).suffix}"
        try:
            content = Path(source).read_bytes()
        except OSError as error:
            raise ModelError(f"{source}: cannot read the skin: {error.strerror or error}") from error
        write_whole(model.parent / names[key], content)
    return skin.model_copy(update=names)


# An array without arrays in it, as tomli_w writes it: an entry a line.
_INNER_ARRAY = re.compile(r"\[\n([^\[\]{}]*?),?\n *\]")


def _on_one_line(array: re.Match[str]) -> str:
    # line by line: names may have blanks in them
    return f"[{' '.join(filter(None, map(str.strip, array[1].splitlines())))}]"


def _rounded(value: Any, decimals: int) -> Any:
    """Numbers with a limited number of digits after the point, in tables and lists."""
    if isinstance(value, float):
        return round(value, decimals)
    if isinstance(value, dict):
        return {key: _rounded(entry, decimals) for key, entry in value.items()}
    if isinstance(value, list):
        return [_rounded(entry, decimals) for entry in value]
    return value


def load_body(path: Path, scale: float = 1.0) -> BodyModel:
    """Reads a body model.

    Args:
        path: a model TOML (see models/gavrila22.toml for a commented one).
        scale: factor of every length.

    Raises:
        ModelError: the file is missing or wrong; the message names the entry.
    """
    description = read_description(path)
    try:
        return description.scaled(scale).build()
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from error
