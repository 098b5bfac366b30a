"""A scanned person's model: the skeleton of a general model put into the scan, superquadrics fitted, the skin beside.

The general model says what the parameters are called, in which direction they count, and which segments are one; the
scan says where the joints are and about which axes they turn. The angles of the scan's pose in the general model's
terms are found limb by limb, so that zero stays what it is there: arms and legs hanging.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from tracker.acquisition.scan import Joint, Scan
from tracker.acquisition.superquadric_fit import Fitted, fit_superquadric
from tracker.arrays import Array
from tracker.body_description import AxisEntry, BodyDescription, LandmarkEntry, PartEntry, SegmentEntry
from tracker.body_sections import SkinSection
from tracker.errors import ModelError, nearest
from tracker.mirror import Mirror

# How much the direction of the next hinge counts against that of the bone itself.
_HINGE = 0.3
# A parameter turns about that axis of the scan's joint whose direction is this near to its own, as a cosine.
_SAME = 0.7
_ACROSS = 0.3
# What a scan stands in can be done: limits that it exceeds are widened to this far beyond it, degrees. Those that it
# keeps stay: elbows that could bend 17 degrees backwards, for the scan has them at 3, did.
_BEYOND_DEG = 20.0


@dataclass
class _Placed:
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


@dataclass(frozen=True)
class Rigged:
    """A scanned person's model, and how well its parts fit the scan."""

    description: BodyDescription
    fits: dict[str, Fitted]
    """Part -> its fit."""


def rigged(general: BodyDescription, scan: Scan, name: str) -> Rigged:
    """A person's model of a scan; its skin has no files yet.

    Args:
        general: the model whose parameters, groups and conventions it has.
        scan: in the model's frame.
        name: of the model.

    Raises:
        ModelError: the scan has no segment of that model.
    """
    owners = _owners(general, scan)
    ratio = _height(scan) / general.stature_m if general.stature_m > 0 else 1.0
    placed, segments = _Placed(), []
    for entry in general.segments:
        segments.append(_segment(entry, general, scan, placed, ratio))
    fits, parts = _parts(scan, owners, placed)
    kept = {part.name for part in parts}
    mirror = Mirror(general.sides, general.across)
    garments = {
        key: tuple(one for one in worn if mirror.meant(one, kept)) for key, worn in general.clothes.garments.items()
    }
    clothes = {
        "garments": {key: worn for key, worn in garments.items() if worn},
        "hair": tuple(one for one in general.clothes.hair if mirror.meant(one, kept)),
    }
    changes = {
        "name": name,
        "about": f"acquired from a scan, from {general.name}",
        "stature_m": _height(scan),
        "segments": tuple(segments),
        "parts": tuple(parts),
        "landmarks": _landmarks(general, scan, placed, ratio),
        "clothes": general.clothes.model_copy(update=clothes),
        "sigmas": {},
        "skin": SkinSection(surface="scan.ply", weights="scan.npz", pose_deg=placed.pose_deg),
    }
    return Rigged(general.model_copy(update=changes), fits)


def _height(scan: Scan) -> float:
    return float(np.ptp(scan.surface.points[:, 2]))


def _owners(general: BodyDescription, scan: Scan) -> dict[str, str]:
    """Segment of the scan -> that of the model which it moves with: of its own name, or of what it hangs on."""
    names = [segment.name for segment in general.segments]
    found = {}
    for segment in scan.rigging.segments:
        above: str | None = segment
        while above is not None and above not in names:
            joint = scan.joint_of(above)
            above = None if joint is None else joint.parent
        found[segment] = above or names[0]
    if not set(names[1:]) & set(scan.rigging.segments):
        raise ModelError(
            f'the scan has no segment of model "{general.name}"; {nearest(names[-1], scan.rigging.segments)}'
        )
    return found


def _segment(entry: SegmentEntry, general: BodyDescription, scan: Scan, placed: _Placed, ratio: float) -> SegmentEntry:
    """A segment with its joint and axes from the scan; what the scan does not know is scaled."""
    joint = scan.joint_of(entry.name)
    if entry.parent == "world":
        placed.rotations[entry.name], placed.centres[entry.name] = np.eye(3), np.zeros(3)
        placed.joints[entry.name] = np.zeros(3)
        return entry.model_copy(update={"joint": (0.0, 0.0, 0.0)})
    turn = placed.rotations[entry.parent]
    if joint is None:
        offset = ratio * (np.array(entry.joint) - _joint_of(general, entry.parent))
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
    return entry.model_copy(update={"joint": _triple(placed.joints[entry.name]), "parameters": tuple(axes)})


def _joint_of(general: BodyDescription, name: str) -> Array:
    return np.array(next(segment.joint for segment in general.segments if segment.name == name))


def _angles(entry: SegmentEntry, general: BodyDescription, scan: Scan, turn: Array) -> Array:
    """Angles (n,) of a limb's segment in the scan, rad; 0 on the midline, whose posture is nobody's but the person's.

    The bone to the next joint must have its direction, and where the next joint is a hinge, its axis.
    """
    n = len(entry.parameters)
    mirror = Mirror(general.sides, general.across)
    behind = next((joint for joint in scan.joints if joint.parent == entry.name), None)
    own, below = scan.joint_of(entry.name), [one for one in general.segments if one.parent == entry.name]
    if not n or mirror.of(entry.name) == entry.name or own is None or behind is None or not below:
        return np.zeros(n)
    general_axes = [np.array(axis.axis, dtype=np.float64) for axis in entry.parameters]
    bone = _unit(np.array(below[0].joint) - np.array(entry.joint))
    wanted = [(bone, _unit(behind.centre - own.centre), 1.0)]
    if n > 1 and 0 < len(below[0].parameters) < 3:
        hinge = _unit(np.array(below[0].parameters[0].axis, dtype=np.float64))
        if "flexion" in behind.axes:
            sign = _sense(hinge, turn, behind.axes["flexion"])
            wanted.append((hinge, sign * behind.axes["flexion"], _HINGE))

    def gaps(angles: Array) -> Array:
        turned = turn
        for axis, angle in zip(general_axes, angles, strict=True):
            turned = turned @ Rotation.from_rotvec(angle * _unit(axis)).as_matrix()
        return np.concatenate([weight * (turned @ one - other) for one, other, weight in wanted] + [1e-3 * angles])

    starts = [np.zeros(n), *(np.eye(n)[k] * way for k in range(n) for way in (0.8, -0.8))]
    found = [least_squares(gaps, start) for start in starts]
    best: Array = min(found, key=lambda one: float(one.cost)).x
    wrapped: Array = (best + np.pi) % (2 * np.pi) - np.pi
    return wrapped


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
    own = _unit(general)
    if joint is None or n > 2 or not joint.axes:
        return own
    axes = [turned.T @ axis for axis in joint.axes.values()]
    best = max(axes, key=lambda axis: abs(float(axis @ own)))
    cosine = float(best @ own)
    return own if abs(cosine) < _SAME else np.sign(cosine) * best


def _widened(axis: AxisEntry, direction: Array, angle_deg: float) -> AxisEntry:
    changes: dict[str, object] = {"axis": _triple(direction)}
    if axis.limits_deg is not None:
        low, high = axis.limits_deg
        low = low if angle_deg >= low else angle_deg - _BEYOND_DEG
        high = high if angle_deg <= high else angle_deg + _BEYOND_DEG
        changes["limits_deg"] = low, high
    return axis.model_copy(update=changes)


def _parts(scan: Scan, owners: dict[str, str], placed: _Placed) -> tuple[dict[str, Fitted], list[PartEntry]]:
    """A superquadric for each segment of the scan, fitted to the vertices that it moves most."""
    labels, areas = scan.rigging.weights.argmax(axis=1), _vertex_areas(scan)
    fits, parts = {}, []
    for k, name in enumerate(scan.rigging.segments):
        own = labels == k
        if not own.any():
            continue
        points, owner = scan.surface.points[own], owners[name]
        middle = areas[own] @ points / areas[own].sum()
        found = fit_superquadric(points, areas[own], _direction(scan, name, middle), np.array([1.0, 0.0, 0.0]))
        fits[name] = found
        rotation, centre, half = found.placement[:3, :3], found.placement[:3, 3], found.shape[2]
        ends = [placed.in_reference(owner, centre + way * half * rotation[:, 2]) for way in (-1, 1)]
        parts.append(
            PartEntry(
                name=name,
                segment=owner,
                start=_triple(ends[0]),
                end=_triple(ends[1]),
                radii=(float(found.shape[0]), float(found.shape[1])),
                squareness=(float(found.shape[3]), float(found.shape[4])),
                taper=(float(found.shape[5]), float(found.shape[6])),
                front=_triple(placed.rotations[owner].T @ rotation[:, 0]),
            )
        )
    return fits, parts


def _direction(scan: Scan, name: str, middle: Array) -> Array:
    """(3,) long axis of a segment: from its joint to the next one, or to the middle of its surface."""
    own = scan.joint_of(name)
    behind = [joint.centre for joint in scan.joints if joint.parent == name]
    if own is None or len(behind) > 1:
        return np.array([0.0, 0.0, 1.0])
    way: Array = (behind[0] if behind else middle) - own.centre
    return way


def _vertex_areas(scan: Scan) -> Array:
    """(N,) area of the surface that each vertex stands for, square metres."""
    corners = scan.surface.points[scan.surface.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    shares = np.bincount(scan.surface.faces.ravel(), areas.repeat(3) / 3, minlength=len(scan.surface.points))
    return np.asarray(shares, dtype=np.float64)


def _landmarks(general: BodyDescription, scan: Scan, placed: _Placed, ratio: float) -> dict[str, LandmarkEntry]:
    """The model's landmarks where the scan has them; others keep their scaled place on their segment."""
    known = scan.marks | {joint.name: joint.centre for joint in scan.joints}
    found = {}
    for name, mark in general.landmarks.items():
        if name in known:
            at = placed.in_reference(mark.segment, known[name])
        else:
            at = placed.joints[mark.segment] + ratio * (np.array(mark.at) - _joint_of(general, mark.segment))
        found[name] = mark.model_copy(update={"at": _triple(at)})
    return found


def _unit(vector: Array) -> Array:
    unit: Array = vector / np.linalg.norm(vector)
    return unit


def _triple(values: Array) -> tuple[float, float, float]:
    a, b, c = np.asarray(values, dtype=np.float64).tolist()
    return a, b, c
