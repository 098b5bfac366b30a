"""A scanned person as files hold it: surface, weights, and joints with their axes; turned into the model's frame."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pydantic
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from tracker.bodies.body.description import BodyDescription
from tracker.bodies.body.entries import AxisEntry, SegmentEntry
from tracker.bodies.segments import Mirror
from tracker.bodies.skin import Rigging, ScannedSurface, read_rigging, read_surface
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


# Segments of a general model placed in a scan: their joints, their axes, and the angles that the scan stands in.

SAME_PLACE_M = 1e-6
"""Joints less apart have no bone between them that points anywhere."""

# How much the direction of the next hinge counts against that of the bone itself.
_HINGE = 0.3
# A parameter turns about that axis of the scan's joint whose direction is this near to its own, as a cosine.
_SAME = 0.7
_ACROSS = 0.3
# What a scan stands in can be done: limits that it exceeds are widened to this far beyond it, degrees. Those that it
# keeps stay: elbows that could bend 17 degrees backwards, for the scan has them at 3, did.
_BEYOND_DEG = 20.0


@dataclass
class Placed:
    """Segments of the model placed in the scan, as far as they are known."""

    rotations: dict[str, Array] = field(default_factory=dict)
    """Segment -> (3, 3) turn from the reference pose to that of the scan."""

    centres: dict[str, Array] = field(default_factory=dict)
    """Segment -> (3,) its joint in the scan, metres."""

    joints: dict[str, Array] = field(default_factory=dict)
    """Segment -> (3,) its joint in the reference pose, metres."""

    pose_deg: dict[str, float] = field(default_factory=dict)

    def in_reference(self, segment: str, point: Array) -> Array:
        """A point (..., 3) of the scan that belongs to a segment, in the reference pose."""
        moved: Array = (point - self.centres[segment]) @ self.rotations[segment] + self.joints[segment]
        return moved


def placed_segment(
    entry: SegmentEntry, general: BodyDescription, scan: Scan, placed: Placed, ratio: float
) -> SegmentEntry:
    """A segment with its joint and axes from the scan; what the scan does not know is scaled."""
    joint = scan.joint_of(entry.name)
    if entry.parent == "world":
        placed.rotations[entry.name], placed.centres[entry.name] = np.eye(3), np.zeros(3)
        placed.joints[entry.name] = np.zeros(3)
        return entry.model_copy(update={"joint": (0.0, 0.0, 0.0)})
    turn = placed.rotations[entry.parent]
    if joint is None:
        offset = ratio * (np.array(entry.joint) - joint_of(general, entry.parent))
        placed.joints[entry.name] = placed.joints[entry.parent] + offset
        placed.centres[entry.name] = placed.centres[entry.parent] + turn @ offset
    else:
        placed.joints[entry.name] = placed.in_reference(entry.parent, joint.centre)
        placed.centres[entry.name] = joint.centre
    angles = _angles(entry, general, scan, turn)
    axes, turned = [], turn
    for axis, angle in zip(entry.parameters, angles, strict=True):
        direction = _axis(np.array(axis.axis), turned, joint, len(entry.parameters))
        turned = turned @ Rotation.from_rotvec(angle * direction).as_matrix()
        placed.pose_deg |= {axis.name: round(float(np.degrees(angle)), 4)} if angle else {}
        axes.append(_widened(axis, direction, float(np.degrees(angle))))
    placed.rotations[entry.name] = turned
    return entry.model_copy(update={"joint": triple(placed.joints[entry.name]), "parameters": tuple(axes)})


def joint_of(general: BodyDescription, name: str) -> Array:
    """(3,) joint of a segment of the general model, metres."""
    return np.array(next(segment.joint for segment in general.segments if segment.name == name))


def _angles(entry: SegmentEntry, general: BodyDescription, scan: Scan, turn: Array) -> Array:
    """Angles (n,) of a limb's segment in the scan, rad; 0 on the midline, whose posture is nobody's but the person's.

    The bone to the next joint must have its direction, and where the next joint is a hinge, its axis.
    """
    n = len(entry.parameters)
    mirror = Mirror(general.sides, general.across)
    own, below = scan.joint_of(entry.name), [one for one in general.segments if one.parent == entry.name]
    below = [one for one in below if math.dist(one.joint, entry.joint) > SAME_PLACE_M]
    behind = None if own is None else next((one for one in scan.joints if _hangs_below(one, own)), None)
    if not n or mirror.of(entry.name) == entry.name or own is None or behind is None or not below:
        return np.zeros(n)
    general_axes = [np.array(axis.axis, dtype=np.float64) for axis in entry.parameters]
    bone = _unit_vector(np.array(below[0].joint) - np.array(entry.joint))
    wanted = [(bone, _unit_vector(behind.centre - own.centre), 1.0)]
    if n > 1 and 0 < len(below[0].parameters) < 3:
        hinge = _unit_vector(np.array(below[0].parameters[0].axis, dtype=np.float64))
        if "flexion" in behind.axes:
            sign = _sense(hinge, turn, behind.axes["flexion"])
            wanted.append((hinge, sign * behind.axes["flexion"], _HINGE))

    def gaps(angles: Array) -> Array:
        turned = turn
        for axis, angle in zip(general_axes, angles, strict=True):
            turned = turned @ Rotation.from_rotvec(angle * _unit_vector(axis)).as_matrix()
        return np.concatenate([weight * (turned @ one - other) for one, other, weight in wanted] + [1e-3 * angles])

    starts = [np.zeros(n), *(np.eye(n)[k] * way for k in range(n) for way in (0.8, -0.8))]
    found = [least_squares(gaps, start) for start in starts]
    best: Array = min(found, key=lambda one: float(one.cost)).x
    wrapped: Array = (best + np.pi) % (2 * np.pi) - np.pi
    return wrapped


def _hangs_below(joint: Joint, own: Joint) -> bool:
    """Whether a joint is at the other end of the bone that begins at another one."""
    return joint.parent == own.child and float(np.linalg.norm(joint.centre - own.centre)) > SAME_PLACE_M


def _sense(hinge: Array, turn: Array, axis: Array) -> float:
    """1 or -1: whether a hinge of the model and an axis of the scan count in the same direction.

    Both go by the right-hand rule, but ankles and knees may be counted either way. Axes across one another, such as
    those of wrists, are of joints that a twist lies between.
    """
    product = float((turn @ hinge) @ axis)
    return -1.0 if product < -_ACROSS else 1.0


def _axis(general: Array, turned: Array, joint: Joint | None, n: int) -> Array:
    """(3,) axis in the reference pose: that of the scan's joint which has about the general model's direction.

    Of three axes in one joint any will do: those of the general model stay.
    """
    own = _unit_vector(general)
    if joint is None or n > 2 or not joint.axes:
        return own
    axes = [turned.T @ axis for axis in joint.axes.values()]
    best = max(axes, key=lambda axis: abs(float(axis @ own)))
    cosine = float(best @ own)
    return own if abs(cosine) < _SAME else np.sign(cosine) * best


def _widened(axis: AxisEntry, direction: Array, angle_deg: float) -> AxisEntry:
    changes: dict[str, object] = {"axis": triple(direction)}
    if axis.limits_deg is not None:
        low, high = axis.limits_deg
        low = low if angle_deg >= low else angle_deg - _BEYOND_DEG
        high = high if angle_deg <= high else angle_deg + _BEYOND_DEG
        changes["limits_deg"] = low, high
    return axis.model_copy(update=changes)


def _unit_vector(vector: Array) -> Array:
    unit: Array = vector / np.linalg.norm(vector)
    return unit


def triple(values: Array) -> tuple[float, float, float]:
    """Three numbers as a model file holds them."""
    a, b, c = np.asarray(values, dtype=np.float64).tolist()
    return a, b, c
