"""Robots as URDF, the description that ROS uses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.bodies.robots import (
    Nested,
    NestedJoint,
    Robot,
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

_KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")

_SLIDES_M = 1.0
"""Either way, of a joint that slides without limits."""


def read_urdf(path: Path) -> Robot:
    """Reads a robot.

    Raises:
        ModelError: the file cannot be read, is no URDF, or its links are no tree.
    """
    root = xml_of(path, ModelError, "a robot")
    if root.tag != "robot":
        raise ModelError(f"{path}: <{root.tag}> found, expected <robot> of a URDF")
    if any("xacro" in node.tag for node in root.iter()) or any(
        "${" in v for n in root.iter() for v in n.attrib.values()
    ):
        raise ModelError(f"{path}: a xacro file, expected the URDF that it makes: xacro {path.name} > robot.urdf")
    unread: list[str] = []
    try:
        joints = [_Edge(node, unread) for node in root.findall("joint")]
        links = {node.get("name", ""): node for node in root.findall("link")}
        order = _parents_first(links, joints)
        visible = "visual" if root.find("link/visual") is not None else "collision"
        nested = [_nested(links[name], edge, visible, path, unread) for name, edge in order]
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from error
    free = any(edge.kind == "floating" for edge in joints)
    follows = {edge.name: edge.follows for edge in joints if edge.follows}
    return assembled(root.get("name") or path.stem, nested, free, [*unread, *mimicking(follows)])


class _Edge:
    """A joint, with the link that it moves and the one it hangs on."""

    def __init__(self, node: Node, unread: list[str]) -> None:
        self.name, self.kind = node.get("name", ""), node.get("type", "")
        where = f'joint "{shortened(self.name)}"'
        if self.kind not in _KINDS:
            raise ModelError(f'{where}: type "{shortened(self.kind)}"; {nearest(self.kind, _KINDS)}')
        self.parent, self.child = (_attribute(node.find(end), "link", f"{where} {end}") for end in ("parent", "child"))
        self.placement = origin_of(node, where)
        axis = node.find("axis")
        self.axis = np.array([1.0, 0, 0]) if axis is None else numbers(axis, "xyz", 3, where)
        if self.kind not in ("fixed", "floating") and not np.linalg.norm(self.axis):
            raise ModelError(f"{where}: its axis has no length")
        mimic = node.find("mimic")
        self.follows = "" if mimic is None else mimic.get("joint", "")
        self.joints = tuple(self._joints(node, where, unread))

    def _joints(self, node: Node, where: str, unread: list[str]) -> Iterator[NestedJoint]:
        if self.kind == "continuous":
            yield NestedJoint(self.name, True, self.axis)
        elif self.kind in ("revolute", "prismatic"):
            rotates = self.kind == "revolute"
            limit = node.find("limit")
            limits = tuple(0.0 if limit is None else _number(limit, key, where) for key in ("lower", "upper"))
            if limits[0] == limits[1]:
                if limits != (0.0, 0.0):
                    unread.append(f"{where} has one value alone, {limits[0]:g}, here it is fixed at zero")
                    return
                limits = (-np.pi, np.pi) if rotates else (-_SLIDES_M, _SLIDES_M)
                unread.append(f"{where} has no limits, here it goes from {limits[0]:g} to {limits[1]:g}")
            yield NestedJoint(self.name, rotates, self.axis, limits=(limits[0], limits[1]))
        elif self.kind == "planar":
            flat = np.linalg.svd(self.axis[None])[2][1:]
            for way, letter in zip(flat, "xy", strict=True):
                yield NestedJoint(f"{self.name}_{letter}", False, way, limits=(-_SLIDES_M, _SLIDES_M))
            yield NestedJoint(f"{self.name}_turn", True, self.axis)
            unread.append(f"{where} slides in a plane without limits, here by {_SLIDES_M:g} m either way")


def _parents_first(links: dict[str, Node], joints: Sequence[_Edge]) -> list[tuple[str, _Edge | None]]:
    """Links with the joints that move them, from the only root on."""
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end not in links:
                raise ModelError(f'joint "{joint.name}": no link "{shortened(end)}"; {nearest(end, links)}')
    above = {joint.child: joint for joint in joints}
    if len(above) < len(joints):
        twice = next(j.child for j in joints if above[j.child] is not j)
        raise ModelError(f'link "{twice}" hangs on two joints, expected a tree')
    roots = [name for name in links if name not in above]
    if len(roots) != 1:
        raise ModelError(f"{len(roots)} links hang on no joint ({', '.join(roots[:5])}), expected one, the base")
    order: list[tuple[str, _Edge | None]] = [(roots[0], None)]
    for name, _ in order:
        order += [(joint.child, joint) for joint in joints if joint.parent == name]
    if len(order) < len(links):
        raise ModelError("links hang on one another in a ring, expected a tree")
    return order


def _nested(link: Node, edge: _Edge | None, visible: str, path: Path, unread: list[str]) -> Nested:
    """A link with its visible shape; with its shape for collisions if the visible one cannot be read."""
    name = link.get("name", "")
    surfaces = _surfaces(link, visible, path, unread)
    if not surfaces and link.find(visible) is not None:
        surfaces = _surfaces(link, "collision", path, [])
        if surfaces:
            unread.append(f'link "{name}" has its shape for collisions here')
    if edge is None:
        return Nested(name, "", np.eye(4), (), surfaces)
    return Nested(name, edge.parent, edge.placement, edge.joints, surfaces)


def _surfaces(link: Node, kind: str, path: Path, unread: list[str]) -> tuple[ScannedSurface, ...]:
    where, found = f'link "{link.get("name", "")}"', []
    for node in link.findall(kind):
        try:
            found.append(moved(_surface(node, where, path), origin_of(node, where)))
        except ModelError as error:
            unread.append(f"a shape of {where}: {error}")
    return tuple(found)


def _surface(visual: Node, where: str, path: Path) -> ScannedSurface:
    geometry = visual.find("geometry")
    for shape in () if geometry is None else geometry:
        if shape.tag == "mesh":
            scale = numbers(shape, "scale", 3, where) if "scale" in shape.attrib else np.ones(3)
            return read_mesh(_mesh_path(_attribute(shape, "filename", where), path), scale)
        if shape.tag == "box":
            return box(numbers(shape, "size", 3, where) / 2)
        if shape.tag == "sphere":
            return ellipsoid(np.full(3, _number(shape, "radius", where)))
        if shape.tag in ("cylinder", "capsule"):
            made = cylinder if shape.tag == "cylinder" else capsule
            return made(_number(shape, "radius", where), _number(shape, "length", where))
        raise ModelError(f"<{shape.tag}>, expected mesh, box, cylinder, sphere or capsule")
    raise ModelError("no geometry")


def _mesh_path(told: str, description: Path) -> Path:
    """Path of a mesh: beside the description, or in the package of ROS around it."""
    package, _, rest = told.removeprefix("package://").removeprefix("model://").partition("/")
    if "://" not in told or told.startswith("file://"):
        return description.parent / told.removeprefix("file://")
    for folder in description.resolve().parents:
        for found in (folder / package / rest, folder / rest):
            if found.is_file():
                return found
    raise ModelError(f"{told}: no folder {package} with it lies around {description}")


def origin_of(node: Node, where: str) -> Array:
    """(4, 4) of an element's <origin>; rolled, pitched, then yawed about fixed axes."""
    told = node.find("origin")
    if told is None:
        return np.eye(4)
    xyz, rpy = (numbers(told, key, 3, where) if key in told.attrib else np.zeros(3) for key in ("xyz", "rpy"))
    return placed(xyz, Rotation.from_euler("xyz", rpy))


def numbers(node: Node, key: str, count: int, where: str) -> Array:
    """Finite numbers of an attribute.

    Raises:
        ModelError: another text stands there.
    """
    text = _attribute(node, key, where)
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.array([])
    if len(values) != count or not np.isfinite(values).all():
        raise ModelError(f"{where}: {key} = {shortened(text)!r}, expected {count} numbers")
    return values


def _number(node: Node, key: str, where: str) -> float:
    return float(numbers(node, key, 1, where)[0]) if key in node.attrib else 0.0


def _attribute(node: Node | None, key: str, where: str) -> str:
    found = None if node is None else node.get(key)
    if found is None:
        raise ModelError(f"{where}: no {key}")
    return found
