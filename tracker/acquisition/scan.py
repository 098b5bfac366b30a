"""A scanned person as files hold it: surface, weights, and joints with their axes; turned into the model's frame."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pydantic

from tracker.bodies.mirror import Mirror
from tracker.bodies.skin_files import Rigging, ScannedSurface, read_rigging, read_surface
from tracker.foundation.arrays import Array, frozen
from tracker.foundation.configuration.components import FilePath, component
from tracker.foundation.errors import ConfigError, nearest
from tracker.foundation.source_files import json_of

_SMALLEST_M, _LARGEST_M = 0.1, 5.0
"""Extent of a scan along its longest axis: what is less is no body, what is more is not in metres."""


@component
class ScanFiles:
    """A laser scan and what a rigging program knows of it, metres, z up; the person may face any direction."""

    surface: FilePath
    """PLY or OBJ file of triangles."""

    weights: FilePath
    """Archive of numpy (.npz): `segments`, names, and `weights` (vertex x segment) or `label` (vertex)."""

    joints: FilePath
    """JSON of `joints`: a list of tables with `name`, `parent`, `child` (segments), `centre_m`, and `axes`, a table of
    vectors; positive angles by the right-hand rule. Further points may stand in `joint_centres_m`, a table."""


class _JointEntry(pydantic.BaseModel):
    """A joint as the file has it."""

    name: str
    parent: str
    child: str
    centre_m: tuple[float, float, float]
    axes: dict[str, tuple[float, float, float]] = {}


@dataclass(frozen=True)
class Joint:
    """A joint of a scan, in the pose that it was made in."""

    name: str
    parent: str
    child: str
    centre: Array
    """(3,) metres."""

    axes: dict[str, Array]
    """Name -> (3,) unit vector."""


@dataclass(frozen=True)
class Scan:
    """A scanned person in the model's frame: x forwards, y to the left, z up, between the joints of the root."""

    surface: ScannedSurface
    rigging: Rigging
    joints: tuple[Joint, ...]
    marks: dict[str, Array]
    """Name -> (3,) further points, metres."""

    def joint_of(self, segment: str) -> Joint | None:
        """The joint that a segment hangs on; None for the root."""
        return next((joint for joint in self.joints if joint.child == segment), None)


def read_scan(files: ScanFiles, mirror: Mirror) -> Scan:
    """Reads a scan and turns it so that the person faces x.

    Args:
        files: where it is.
        mirror: words of the sides in its names.

    Raises:
        ModelError: surface or weights are wrong.
        ConfigError: the joints are, or it is not in metres.
    """
    surface = read_surface(files.surface)
    extent = float(np.ptp(surface.points, axis=0).max())
    if not _SMALLEST_M < extent < _LARGEST_M:
        raise ConfigError(f"{files.surface}: a surface of {extent:.3g} m, expected one person in metres: other units?")
    rigging = read_rigging(files.weights, len(surface.points))
    table = json_of(files.joints, ConfigError)
    entries = _joints(table, files.joints, rigging.segments)
    frame = _frame(entries, mirror, files.joints)

    def placed(point: Any) -> Array:
        return frozen(frame[:3, :3] @ np.asarray(point, dtype=np.float64) + frame[:3, 3])

    joints = tuple(
        Joint(
            one.name,
            one.parent,
            one.child,
            placed(one.centre_m),
            {name: frozen(frame[:3, :3] @ _unit(axis, one.name, files.joints)) for name, axis in one.axes.items()},
        )
        for one in entries
    )
    points = surface.points @ frame[:3, :3].T + frame[:3, 3]
    marks = {_spelt(name, mirror): placed(point) for name, point in _marks(table, files.joints).items()}
    return Scan(ScannedSurface(points, surface.faces), rigging, joints, marks)


def _joints(table: Any, path: Path, segments: tuple[str, ...]) -> list[_JointEntry]:
    found = table.get("joints") if isinstance(table, dict) else None
    if not isinstance(found, list) or not found:
        raise ConfigError(f'{path}: expected a list "joints" of tables with name, parent, child, centre_m and axes')
    try:
        entries = [_JointEntry.model_validate(one) for one in found]
    except pydantic.ValidationError as error:
        first = error.errors()[0]
        raise ConfigError(f"{path}: joints: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error
    for one in entries:
        for segment in (one.parent, one.child):
            if segment not in segments:
                raise ConfigError(
                    f'{path}: joint "{one.name}": no segment "{segment}" in the weights; {nearest(segment, segments)}'
                )
    return entries


def _frame(entries: list[_JointEntry], mirror: Mirror, path: Path) -> Array:
    """(4, 4) model from scan: y runs from the right joints to the left ones, the origin is between those of the root.

    Raises:
        ConfigError: there are no pairs of joints.
    """
    centres = {one.name: np.array(one.centre_m) for one in entries}
    pairs = [(name, mirror.of(name)) for name in centres if mirror.sides[0] in name.split("_")]
    pairs = [pair for pair in pairs if pair[1] in centres]
    root = _root(entries)
    at_root = {one.name for one in entries if one.parent == root}
    middle = [(centres[one] + centres[other]) / 2 for one, other in pairs if one in at_root]
    left = np.zeros(3)
    for one, other in pairs:
        left[:2] += (centres[one] - centres[other])[:2]
    if not middle or np.linalg.norm(left) < 1e-6:
        words = " and ".join(mirror.sides)
        raise ConfigError(f'{path}: expected joints of both sides on "{root}", named with {words}')
    left /= np.linalg.norm(left)
    up = np.array([0.0, 0.0, 1.0])
    frame = np.eye(4)
    frame[:3, :3] = np.cross(left, up), left, up
    frame[:3, 3] = -frame[:3, :3] @ np.mean(middle, axis=0)
    return frame


def _root(entries: list[_JointEntry]) -> str:
    children = {one.child for one in entries}
    return next((one.parent for one in entries if one.parent not in children), entries[0].parent)


def _unit(axis: tuple[float, float, float], name: str, path: Path) -> Array:
    length = float(np.linalg.norm(axis))
    if not 0.5 < length < 2:
        raise ConfigError(f'{path}: joint "{name}": an axis of length {length:g}, expected a unit vector')
    return np.array(axis) / length


def _marks(table: Any, path: Path) -> dict[str, Any]:
    found = table.get("joint_centres_m", {})
    good = isinstance(found, dict) and all(
        isinstance(point, list) and len(point) == 3 and all(isinstance(value, (int, float)) for value in point)
        for point in found.values()
    )
    if not good:
        raise ConfigError(f'{path}: "joint_centres_m": expected a table of points of three numbers')
    return dict(found)


def _spelt(name: str, mirror: Mirror) -> str:
    """A name with its side in full: `l_wrist` is `left_wrist`."""
    for word in mirror.sides:
        name = re.sub(rf"^{word[0]}_", f"{word}_", name)
    return name
