"""A model of OpenSim that a user has: where it lies, and what its bodies, coordinates and markers are called."""

from __future__ import annotations

import copy
import dataclasses
import importlib.util
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tracker.foundation.configuration.components import RelativePath
from tracker.foundation.errors import ConfigError, nearest
from tracker.foundation.source_files import xml_of
from tracker.results.recording._xml import Node, write_xml

FILES = {
    "laiuhlrich": ("LaiUhlrich2022.osim", "RajagopalLaiUhlrich2023.osim"),
    "pose2sim": ("Model_Pose2Sim_simple.osim",),
    "rajagopal": ("Rajagopal2016.osim", "Rajagopal2015.osim"),
}
"""Word for a model of the field -> its file, the preferred one first."""


@dataclasses.dataclass(frozen=True)
class OsimName(RelativePath):
    """Marks a model of OpenSim: a word of `FILES`, or a path."""

    def resolved(self, text: str, folder: Path) -> str:
        """The absolute path.

        Raises:
            ConfigError: nothing is called so, or its file is in none of the places where programs leave it.
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
    """Folders of models: those that OpenSim's installer leaves with the user, and those in Pose2Sim's package."""
    yield from sorted((Path.home() / "Documents" / "OpenSim").glob("*/Models/*"), reverse=True)
    package = importlib.util.find_spec("Pose2Sim")
    for place in (package and package.submodule_search_locations) or ():
        yield Path(place) / "OpenSim_Setup"


@dataclass(frozen=True)
class OsimModel:
    """What set-up files need to know of a model."""

    path: Path
    root: Node
    """Its outermost element."""

    bodies: frozenset[str]
    coordinates: tuple[str, ...]
    """Of its joints, except those of the joint with the ground, which place it in the world."""

    markers: frozenset[str]
    """Markers that it has of its own."""


def read_osim(path: Path) -> OsimModel:
    """Reads names out of a model file, of any version of OpenSim.

    Raises:
        ConfigError: the file cannot be read, or is none of a model.
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
    """Writes the model as it is, except that it may turn all round and go anywhere.

    Rajagopal's cannot turn beyond 90 degrees from x: of somebody who did, inverse kinematics bent the limbs instead,
    and markers were 90 mm off.
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
