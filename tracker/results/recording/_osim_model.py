"""A user's model of OpenSim: its file, and the names of its bodies, coordinates and markers."""

from __future__ import annotations

import copy
import dataclasses
import importlib.util
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tracker.bodies.body import BodyModel
from tracker.bodies.segments import Landmark
from tracker.foundation.configuration.components import RelativePath
from tracker.foundation.errors import ConfigError, ModelError, nearest
from tracker.foundation.source_files import xml_of
from tracker.results.recording._motion import Node, exported_name, markers_of, write_xml

FILES = {
    "laiuhlrich": ("LaiUhlrich2022.osim", "RajagopalLaiUhlrich2023.osim"),
    "pose2sim": ("Model_Pose2Sim_simple.osim",),
    "rajagopal": ("Rajagopal2016.osim", "Rajagopal2015.osim"),
}
"""Short name of a well-known model -> its file, the preferred one first."""


@dataclasses.dataclass(frozen=True)
class OsimName(RelativePath):
    """Marks a model of OpenSim: a name in `FILES`, or a path."""

    def resolved(self, text: str, folder: Path) -> str:
        """The absolute path.

        Raises:
            ConfigError: nothing has the name, or its file is in none of the usual folders.
        """
        if text not in FILES and Path(text).suffix:
            return super().resolved(text, folder)
        if text not in FILES:
            raise ConfigError(
                f'no model of OpenSim is called "{text}"; {nearest(text, FILES)}, or a path to an .osim file'
            )
        for place in (folder, *_places()):
            for name in FILES[text]:
                if (place / name).is_file():
                    return str((place / name).resolve())
        raise ConfigError(
            f"{' or '.join(FILES[text])}: neither in {folder.resolve()} nor where OpenSim and Pose2Sim leave their "
            "models; give the path to the .osim file"
        )


def _places() -> Iterator[Path]:
    """Folders of models: of OpenSim's installer, and of Pose2Sim's package."""
    yield from sorted((Path.home() / "Documents" / "OpenSim").glob("*/Models/*"), reverse=True)
    package = importlib.util.find_spec("Pose2Sim")
    for place in (package and package.submodule_search_locations) or ():
        yield Path(place) / "OpenSim_Setup"


@dataclass(frozen=True)
class OsimModel:
    """Names in a model that set-up files need."""

    path: Path
    root: Node
    """Its outermost element."""

    bodies: frozenset[str]
    coordinates: tuple[str, ...]
    """Coordinates of its joints, except those of the joint with the ground, which place it in the world."""

    markers: frozenset[str]
    """Its own markers."""


def read_osim(path: Path) -> OsimModel:
    """Reads names out of a model file, of any version of OpenSim.

    Raises:
        ConfigError: the file cannot be read, or is not a model.
    """
    root = xml_of(path, ConfigError, "a model of OpenSim")
    model = root.find("Model")
    if root.tag != "OpenSimDocument" or model is None:
        raise ConfigError(f"{path}: no model of OpenSim in it, expected OpenSimDocument with Model, found {root.tag}")

    def names(kind: str) -> Iterator[str]:
        return (entry.get("name", "") for entry in model.iter(kind))

    placing = {id(coordinate) for coordinate in _placing(root)}
    bending = (entry.get("name", "") for entry in model.iter("Coordinate") if id(entry) not in placing)
    return OsimModel(path, root, frozenset(names("Body")), tuple(bending), frozenset(names("Marker")))


def write_turning(path: Path, model: OsimModel) -> None:
    """Writes the model unchanged, except that it may turn all round and go anywhere.

    Rajagopal's cannot turn beyond 90 degrees from x. When a person did, inverse kinematics bent the limbs instead, and
    markers were 90 mm off.
    """
    root = copy.deepcopy(model.root)
    for coordinate in _placing(root):
        for clamped in coordinate.findall("clamped"):
            clamped.text = "false"
    write_xml(path, root)


def _placing(root: Node) -> Iterator[Node]:
    """The coordinates of the joint with the ground."""
    for joint in root.iter():
        if _hangs_on_ground(joint):
            yield from joint.iter("Coordinate")


def _hangs_on_ground(joint: Node) -> bool:
    """Whether an element is a joint with the ground, in files of OpenSim 4 and of those before."""
    frames = joint.find("frames")
    parents = [] if frames is None else [frame.findtext("socket_parent", "") for frame in frames]
    told = [joint.findtext("parent_body", ""), joint.findtext("socket_parent_frame", ""), *parents]
    return any(name.strip() in ("ground", "/ground") for name in told)


# Markers that a model of OpenSim and a body of ours share: joint centres, feet and face, points on surfaces.

_ORIGIN = (0.0, 0.0, 0.0)
"""Our point on a body: the joint centre, and for the heel bone its hindmost point."""

_TIP = (0.24, 0.0, 0.0)
"""Points of Rajagopal's foot, in the frame of its heel bone, metres; scaling compares the length of the foot."""

_SIDED = (
    ("hip", "femur", ("Hip", "HJC"), _ORIGIN),
    ("knee", "tibia", ("Knee", "KJC"), _ORIGIN),
    ("ankle", "talus", ("Ankle", "AJC"), _ORIGIN),
    ("heel", "calcn", ("Heel",), _ORIGIN),
    ("toe", "calcn", ("BigToe",), _TIP),
    ("small_toe", "calcn", ("SmallToe",), None),
    ("shoulder", "humerus", ("Shoulder", "SJC"), _ORIGIN),
    ("elbow", "ulna", ("Elbow", "EJC"), _ORIGIN),
    ("wrist", "hand", ("Wrist",), _ORIGIN),
    ("eye", "head", ("Eye",), None),
    ("ear", "head", ("Ear",), None),
)
"""Our point, body of the model, rest of its name after L or R (in Pose2Sim and OpenCap, in Rajagopal's model), and its
known place on that body."""

_MIDDLE = (
    ("pelvis", "pelvis", ("midHip", "Hip")),
    ("neck", "torso", ("Neck",)),
    ("nose", "head", ("Nose",)),
    ("head_top", "head", ("Head",)),
)
"""The same for unpaired points; their places on those bodies are unknown."""

_SURFACES = (
    *(("pelvis", "pelvis"), ("neck", "torso"), ("head_top", "head"), ("hip", "femur"), ("knee", "tibia")),
    *(("ankle", "calcn"), ("shoulder", "humerus"), ("elbow", "ulna"), ("wrist", "hand")),
)
"""Landmark -> body with the surface of its segment; the first one of a segment counts."""


Place = tuple[float, float, float]


@dataclass(frozen=True)
class OsimMarker:
    """A marker of both models."""

    name: str
    mark: Landmark
    """Segment of our body."""

    body: str
    """Body of OpenSim's model."""

    place: Place | None
    """Place on that body, metres; None if only our body shows it, as for all points on surfaces."""


def markers_on(body: BodyModel, model: OsimModel) -> tuple[OsimMarker, ...]:
    """The markers of a body of ours on a model.

    Points without a body in the model, such as the head's, are left out.

    Raises:
        ModelError: fewer than the hips and the knees are left.
    """
    points = {mark.name: mark for mark in (*body.landmarks, *body.keypoints)}
    centres = [
        OsimMarker(_called(names, model), points[own], on, place)
        for own, on, names, place in _rows()
        if own in points and on in model.bodies
    ]
    known = {marker.mark.name for marker in centres}
    missing = [name for name in ("left_hip", "right_hip", "left_knee", "right_knee") if name not in known]
    if missing:
        raise ModelError(
            f'opensim: the model "{body.name}" and {model.path.name} have no {missing[0]} in common, expected a person '
            "with legs, and a model with the bodies pelvis, femur_l, femur_r, tibia_l, tibia_r"
        )
    return (*centres, *_on_surfaces(body, model))


def _rows() -> Iterator[tuple[str, str, tuple[str, ...], Place | None]]:
    """Our point, body, names of its marker, the usual one first, place on the body."""
    for own, on, names in _MIDDLE:
        yield own, on, names, None
    for own, on, names, place in _SIDED:
        for side in ("left", "right"):
            named = tuple(f"{side[0].upper()}{name}" for name in names)
            yield f"{side}_{own}", on if on == "head" else f"{on}_{side[0]}", named, place


def _called(names: tuple[str, ...], model: OsimModel) -> str:
    """The name in the model, else the usual one."""
    return next((name for name in names if name in model.markers), names[0])


def _on_surfaces(body: BodyModel, model: OsimModel) -> Iterator[OsimMarker]:
    """Three points of each segment: joint centres alone leave a segment free to turn about the line between them."""
    bodies = _bodies_of_segments(body)
    for mark in markers_of(body)[len(body.landmarks) :]:
        on = bodies.get(mark.segment)
        if on in model.bodies:
            yield OsimMarker(exported_name(mark.name), mark, str(on), None)


def _bodies_of_segments(body: BodyModel) -> dict[str, str]:
    holders = {mark.name: mark.segment for mark in body.landmarks}
    turning = {segment.name for segment in body.segments if len(segment.parameters) > 1}
    found: dict[str, str] = {}
    for landmark, on in _SURFACES:
        for name, suffix in ((landmark, ""), (f"left_{landmark}", "_l"), (f"right_{landmark}", "_r")):
            if name in holders:
                # a forearm that turns about itself carries the bone that does
                bone = "radius" if on == "ulna" and holders[name] in turning else on
                found.setdefault(holders[name], f"{bone}{suffix}")
    return found
