"""What an MJCF file leaves to its settings and classes: angles, folders of meshes, attributes that are told once."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.bodies.robots._shapes import along
from tracker.foundation.arrays import Array
from tracker.foundation.errors import ModelError, nearest, shortened
from tracker.foundation.source_files import xml_of

Node = ElementTree.Element

_MOST_INCLUDED = 100
"""Files that one includes: more than these include one another in a ring."""


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
        """The orientation that an element tells, in one of five ways, or none.

        Raises:
            ModelError: numbers that are none.
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
        ModelError: places are told in the world, as files of before 2022 may.
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
        ModelError: something else stands there.
    """
    try:
        values = np.array([float(word) for word in told[key].split()])
    except (KeyError, ValueError):
        values = np.array([])
    if len(values) != count or not np.isfinite(values).all():
        raise ModelError(f"{key} = {shortened(told.get(key, ''))!r}, expected {count} numbers")
    return values
