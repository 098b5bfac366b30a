"""Segments of a general model placed in a scan: their joints, their axes, and the angles that the scan stands in."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from tracker.acquisition.scan import Joint, Scan
from tracker.bodies.body.description import BodyDescription
from tracker.bodies.body.entries import AxisEntry, SegmentEntry
from tracker.bodies.mirror import Mirror
from tracker.foundation.arrays import Array

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
    own = _unit(general)
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


def _unit(vector: Array) -> Array:
    unit: Array = vector / np.linalg.norm(vector)
    return unit


def triple(values: Array) -> tuple[float, float, float]:
    """Three numbers as a model file holds them."""
    a, b, c = np.asarray(values, dtype=np.float64).tolist()
    return a, b, c
