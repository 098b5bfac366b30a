"""Robots as MJCF, the description that MuJoCo uses."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.bodies.robots import (
    Nested,
    NestedJoint,
    Robot,
    along,
    assembled,
    box,
    capsule,
    cylinder,
    ellipsoid,
    mimicking,
    moved,
    placed,
    read_mesh,
)
from tracker.bodies.skin import ScannedSurface
from tracker.foundation.arrays import Array
from tracker.foundation.errors import ModelError, nearest, shortened
from tracker.foundation.source_files import xml_of

Node = ElementTree.Element

_MOST_INCLUDED = 100
"""Largest number of included files: more include one another in a ring."""


@dataclass(frozen=True)
class Settings:
    """Settings of the compiler, classes of attributes, and meshes."""

    folder: Path
    """Where the paths of meshes start."""

    degrees: bool
    sequence: str
    """Axes of Euler angles, as scipy names them: small letters are fixed axes, capitals turn along."""

    autolimits: bool
    classes: dict[str, dict[str, dict[str, str]]]
    """Class -> element -> attributes."""

    meshes: dict[str, dict[str, str]]
    """Name -> attributes."""

    def told(self, node: Node, inherited: str) -> dict[str, str]:
        """Attributes of an element, with those of its class, or of the one inherited from the body.

        Raises:
            ModelError: there is no such class.
        """
        name = node.get("class", inherited)
        if name not in self.classes:
            raise ModelError(f'class "{shortened(name)}"; {nearest(name, self.classes)}')
        return {**self.classes[name].get(node.tag, {}), **node.attrib}

    def angle(self, value: float) -> float:
        """An angle of the file, rad."""
        return float(np.radians(value)) if self.degrees else value

    def rotation(self, told: dict[str, str]) -> Rotation:
        """The orientation of an element, in one of five notations, or none.

        Raises:
            ModelError: numbers are wrong.
        """
        if "quat" in told:
            w, x, y, z = numbers_of(told, "quat", 4)
            return Rotation.from_quat([x, y, z, w])
        if "axisangle" in told:
            x, y, z, turn = numbers_of(told, "axisangle", 4)
            axis = np.array([x, y, z])
            return Rotation.from_rotvec(self.angle(turn) * axis / np.linalg.norm(axis))
        if "euler" in told:
            return Rotation.from_euler(self.sequence, [self.angle(one) for one in numbers_of(told, "euler", 3)])
        if "xyaxes" in told:
            axes = numbers_of(told, "xyaxes", 6).reshape(2, 3)
            x_axis = axes[0] / np.linalg.norm(axes[0])
            y_axis = axes[1] - (axes[1] @ x_axis) * x_axis
            y_axis /= np.linalg.norm(y_axis)
            return Rotation.from_matrix(np.stack([x_axis, y_axis, np.cross(x_axis, y_axis)], axis=1))
        if "zaxis" in told:
            return along(np.zeros(3), numbers_of(told, "zaxis", 3))[1]
        return Rotation.identity()


def settings_of(root: Node, path: Path) -> Settings:
    """The settings of a file with all that it includes.

    Raises:
        ModelError: positions are in the world, as in files before 2022.
    """
    compiler: dict[str, str] = {}
    for node in root.findall("compiler"):
        compiler |= node.attrib
    if compiler.get("coordinate", "local") != "local":
        raise ModelError(
            'coordinate="global": places in the world, which MuJoCo itself reads no more; save it by MuJoCo 2.1'
        )
    classes: dict[str, dict[str, dict[str, str]]] = {}
    for node in root.findall("default"):
        _add_class(node, "main", {}, classes)
    classes.setdefault("main", {})
    meshes: dict[str, dict[str, str]] = {}
    for node in root.findall("asset/mesh"):
        told = {
            **classes["main"].get("mesh", {}),
            **classes.get(node.get("class", "main"), {}).get("mesh", {}),
            **node.attrib,
        }
        meshes[told.get("name") or Path(told.get("file", "")).stem] = told
    folder = path.parent / compiler.get("meshdir", compiler.get("assetdir", ""))
    sequence = compiler.get("eulerseq", "xyz")
    # small letters turn along there, capitals are fixed: the other way round than scipy's
    degrees, autolimits = compiler.get("angle", "degree") == "degree", compiler.get("autolimits", "true") == "true"
    return Settings(folder, degrees, sequence.swapcase(), autolimits, classes, meshes)


def _add_class(
    node: Node, usual: str, above: dict[str, dict[str, str]], classes: dict[str, dict[str, dict[str, str]]]
) -> None:
    own = copy.deepcopy(classes.get(node.get("class", usual), above))
    for child in node:
        if child.tag != "default":
            own[child.tag] = {**own.get(child.tag, {}), **child.attrib}
    classes[node.get("class", usual)] = own
    for child in node.findall("default"):
        _add_class(child, "", own, classes)


def with_included(path: Path) -> Node:
    """The outermost element of an MJCF file, what it includes put in its place.

    Raises:
        ModelError: a file cannot be read, or files include one another.
    """
    root = xml_of(path, ModelError, "a robot")
    left = [_MOST_INCLUDED]
    _include(root, path.parent, left)
    return root


def _include(node: Node, folder: Path, left: list[int]) -> None:
    for k in reversed(range(len(node))):
        child = node[k]
        if child.tag == "include":
            left[0] -= 1
            if left[0] < 0:
                raise ModelError(f"{folder}: more than {_MOST_INCLUDED} files included: do they include one another?")
            other = xml_of(folder / child.get("file", ""), ModelError, "an included file")
            _include(other, folder, left)
            node[k : k + 1] = list(other)
        else:
            _include(child, folder, left)


def numbers_of(told: dict[str, str], key: str, count: int) -> Array:
    """Finite numbers of an attribute.

    Raises:
        ModelError: another text stands there.
    """
    try:
        values = np.array([float(word) for word in told[key].split()])
    except (KeyError, ValueError):
        values = np.array([])
    if len(values) != count or not np.isfinite(values).all():
        raise ModelError(f"{key} = {shortened(told.get(key, ''))!r}, expected {count} numbers")
    return values


_HIDDEN = 3
"""Groups from this one on are not shown by MuJoCo's viewer: shapes for collisions."""

_FLOORS = {"plane", "hfield"}
"""Shapes of the ground, which is no part of a robot."""

_NOT_READ = ("composite", "flexcomp", "attach", "replicate", "flex", "skin")
"""Elements that make or deform shapes."""

_SLIDES_M = 1.0
"""Either way, of a joint that slides without limits."""


def read_mjcf(path: Path) -> Robot:
    """Reads a robot; of several ones in a file that with most joints.

    Raises:
        ModelError: the file cannot be read, or there is no body in it.
    """
    root = with_included(path)
    try:
        return _Reader(root, path).robot()
    except ModelError as error:
        raise error if str(error).startswith(str(path.parent)) else ModelError(f"{path}: {error}") from error


class _Reader:
    """Reads the bodies of a file."""

    def __init__(self, root: Node, path: Path) -> None:
        self._root, self._path, self._unread = root, path, list[str]()
        self._settings: Settings = settings_of(root, path)
        self._numbers = itertools.count(1)
        self._free: set[str] = set()

    def robot(self) -> Robot:
        """The robot."""
        world = self._root.find("worldbody")
        tops = [] if world is None else list(self._in_frames(world, np.eye(4), "main", {"body"}))
        if not tops:
            raise ModelError("no body in it, expected <worldbody> with one")
        trees = [list(self._nested(node, "", frame, inherited)) for node, frame, inherited in tops]
        most = max(trees, key=lambda tree: sum(len(link.joints) for link in tree))
        others = [tree[0].name for tree in trees if tree is not most]
        if others:
            self._unread.append(f'"{most[0].name}" is taken; left out: {", ".join(others[:5])}')
        for tag in _NOT_READ:
            if self._root.find(f".//{tag}") is not None:
                self._unread.append(f"<{tag}> is not read")
        for coupled in self._root.findall("equality/joint"):
            if coupled.get("joint2"):
                self._unread += mimicking({coupled.get("joint1", ""): coupled.get("joint2", "")})
        free = bool(self._free & {link.name for link in most})
        return assembled(self._root.get("model") or self._path.stem, most, free, self._unread)

    def _in_frames(self, node: Node, frame: Array, inherited: str, tags: set[str]) -> Iterator[tuple[Node, Array, str]]:
        """Children of a body, with their frames that stand between, each with its place and class inherited."""
        for child in node:
            if child.tag == "frame":
                told = child.attrib
                inner = frame @ self._placement(told)
                yield from self._in_frames(child, inner, child.get("childclass", inherited), tags)
            elif child.tag in tags:
                yield child, frame, inherited

    def _placement(self, told: dict[str, str]) -> Array:
        xyz = numbers_of(told, "pos", 3) if "pos" in told else np.zeros(3)
        return placed(xyz, self._settings.rotation(told))

    def _nested(self, node: Node, parent: str, frame: Array, inherited: str) -> Iterator[Nested]:
        """A body and those on it."""
        inherited = node.get("childclass", inherited)
        name = node.get("name") or f"body_{next(self._numbers)}"
        joints = tuple(
            joint
            for entry, place, own in self._in_frames(node, np.eye(4), inherited, {"joint", "freejoint"})
            for joint in self._joints(entry, place, own, name)
        )
        surfaces = []
        for entry, place, own in self._in_frames(node, np.eye(4), inherited, {"geom"}):
            try:
                surface = self._surface(self._settings.told(entry, own))
            except ModelError as error:
                self._unread.append(f'a shape of body "{name}": {error}')
                continue
            if surface is not None:
                surfaces.append(moved(surface, place))
        yield Nested(name, parent, frame @ self._placement(node.attrib), joints, tuple(surfaces))
        for child, place, own in self._in_frames(node, np.eye(4), inherited, {"body"}):
            yield from self._nested(child, name, place, own)

    def _joints(self, node: Node, place: Array, inherited: str, body: str) -> Iterator[NestedJoint]:
        told = self._settings.told(node, inherited)
        kind = "free" if node.tag == "freejoint" else told.get("type", "hinge")
        name = told.get("name") or f"{body}_{kind}_{next(self._numbers)}"
        if kind == "free":
            self._free.add(body)
            return
        point = numbers_of(told, "pos", 3) if "pos" in told else np.zeros(3)
        point = place[:3, :3] @ point + place[:3, 3]
        if kind == "ball":
            most = self._limits(told, "ball")[1]
            for letter, axis in zip("xyz", np.eye(3), strict=True):
                yield NestedJoint(f"{name}_{letter}", True, place[:3, :3] @ axis, point, (-most, most))
            return
        if kind not in ("hinge", "slide"):
            raise ModelError(f'joint "{name}": type "{kind}", expected hinge, slide, ball or free')
        axis = numbers_of(told, "axis", 3) if "axis" in told else np.array([0.0, 0, 1])
        if not np.linalg.norm(axis):
            raise ModelError(f'joint "{name}": its axis has no length')
        yield NestedJoint(name, kind == "hinge", place[:3, :3] @ axis, point, self._limits(told, kind))

    def _limits(self, told: dict[str, str], kind: str) -> tuple[float, float]:
        """Rad or m, from where the file has the robot on, which is not zero where it tells `ref`."""
        limited = told.get("limited", "auto")
        if limited == "true" or (limited == "auto" and self._settings.autolimits and "range" in told):
            low, high = numbers_of(told, "range", 2)
            zero = float(told.get("ref", 0))
            ends = low - zero, high - zero
            return ends if kind == "slide" else (self._settings.angle(ends[0]), self._settings.angle(ends[1]))
        most = {"slide": _SLIDES_M, "ball": np.pi, "hinge": 200 * np.pi}[kind]
        return -most, most

    def _surface(self, told: dict[str, str]) -> ScannedSurface | None:
        """What is seen of a geom in the frame of its body; None for what the viewer hides, and for the ground."""
        kind = told.get("type", "mesh" if "mesh" in told else "sphere")
        transparent = "rgba" in told and numbers_of(told, "rgba", 4)[3] == 0
        if int(told.get("group", 0)) >= _HIDDEN or transparent or kind in _FLOORS:
            return None
        if kind == "mesh":
            return moved(self._mesh(told.get("mesh", "")), self._placement(told))
        if kind not in ("sphere", "capsule", "cylinder", "ellipsoid", "box"):
            raise ModelError(f'type "{kind}"')
        size = np.array([float(word) for word in told.get("size", "").split()])
        placement = self._placement(told)
        if "fromto" in told:
            ends = numbers_of(told, "fromto", 6).reshape(2, 3)
            middle, turn, length = along(ends[0], ends[1])
            placement = placed(middle, turn)
            rest = size[[0, 0]] if len(size) == 1 or kind in ("capsule", "cylinder") else size[:2]
            size = np.array([rest[0], length / 2]) if kind in ("capsule", "cylinder") else np.array([*rest, length / 2])
        wanted = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}[kind]
        if len(size) < wanted or not (size[:wanted] > 0).all():
            raise ModelError(f"{kind} of size {told.get('size', '')!r}, expected {wanted} numbers")
        return moved(_primitive(kind, size), placement)

    def _mesh(self, name: str) -> ScannedSurface:
        if name not in self._settings.meshes:
            raise ModelError(f'no mesh "{name}"')
        told = self._settings.meshes[name]
        scale = numbers_of(told, "scale", 3) if "scale" in told else np.ones(3)
        if "file" not in told:
            raise ModelError(f'mesh "{name}": its points stand in the file, which is not read')
        surface = read_mesh(self._settings.folder / told["file"], scale)
        if "refpos" in told or "refquat" in told:
            reference = placed(
                numbers_of(told, "refpos", 3) if "refpos" in told else np.zeros(3),
                self._settings.rotation({"quat": told["refquat"]}) if "refquat" in told else Rotation.identity(),
            )
            surface = moved(surface, np.linalg.inv(reference).astype(np.float64))
        return surface


def _primitive(kind: str, size: Array) -> ScannedSurface:
    if kind == "box":
        return box(size[:3])
    if kind in ("sphere", "ellipsoid"):
        return ellipsoid(np.full(3, size[0]) if kind == "sphere" else size[:3])
    return (cylinder if kind == "cylinder" else capsule)(float(size[0]), 2 * float(size[1]))
