"""The body as an OpenSim model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.segments import Part, Segment
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.results.recording import RunContext
from tracker.results.recording._motion import (
    Y_UP,
    Motion,
    MotionRecorder,
    Node,
    child,
    euler_angles,
    exported_name,
    markers_of,
    write_xml,
)

_DENSITY_KG_M3 = 1000.0
"""Density of the body, about that of water (Dempster 1955: 990 to 1160 for human segments)."""

_FREE = 99999.9
"""OpenSim's own range of a coordinate without limits."""


@component
class Osim:
    """`NAME.osim` for each person, OpenSim 4: the segments as bodies, the pose parameters as coordinates, all markers.

    The model's world has y up, as OpenSim's; markers are those of `trc` with `y_up = true`. Parts are shown as
    ellipsoids. A joint that OpenSim lacks, like one that slides along an axis it turns, becomes two or more, with
    bodies of a gram between. Masses are those of ellipsoids of water, a placeholder; kinematics ignores them.
    """

    def begin(self, run: RunContext) -> MotionRecorder:
        """Keeps the bodies; the files are written at the end."""
        return MotionRecorder(run, _written)


def _written(motion: Motion, folder: Path) -> Path:
    path = folder / f"{motion.name}.osim"
    document = Node("OpenSimDocument", {"Version": "40500"})
    document.append(_model(motion.body, exported_name(motion.name)))
    write_xml(path, document)
    return path


def _model(body: BodyModel, name: str) -> Node:
    model = Node("Model", {"name": name})
    child(model, "Ground", name="ground")
    child(model, "credits", "bodytrack; masses are placeholders")
    child(model, "length_units", "meters")
    child(model, "force_units", "N")
    child(model, "gravity", "0 -9.80665 0")
    bodies = child(child(model, "BodySet", name="bodyset"), "objects")
    joints = child(child(model, "JointSet", name="jointset"), "objects")
    markers = child(child(model, "MarkerSet", name="markerset"), "objects")
    for segment in body.segments:
        names = _body_names(body, segment)
        for name in names[:-1]:
            bodies.append(_body(replace(segment, name=name), ()))
        bodies.append(_body(segment, [part for part in body.parts if part.segment == segment.name]))
        for joint in _joints(body, segment, names):
            joints.append(joint)
    origins = {segment.name: segment.joint for segment in body.segments}
    for mark in markers_of(body):
        marker = child(markers, "Marker", name=exported_name(mark.name))
        child(marker, "socket_parent_frame", f"/bodyset/{exported_name(mark.segment)}")
        child(marker, "location", _numbers(mark.point - origins[mark.segment]))
        child(marker, "fixed", "true")
    return model


def _numbers(values: Sequence[float] | Array) -> str:
    return " ".join(f"{value:.12g}" for value in values)


def _body(segment: Segment, parts: Sequence[Part]) -> Node:
    body = Node("Body", {"name": exported_name(segment.name)})
    frames = child(body, "components")
    for part in parts:
        placed = part.model_from_part
        frame = _frame(f"{exported_name(part.name)}_frame", "..", placed[:3, 3] - segment.joint, placed[:3, :3])
        shape = child(child(frame, "attached_geometry"), "Ellipsoid", name=exported_name(part.name))
        child(shape, "socket_frame", "..")
        child(shape, "radii", _numbers(part.shape.size))
        child(child(shape, "Appearance"), "color", "0.85 0.75 0.65")
        frames.append(frame)
    mass, centre, inertia = _mass(segment, parts)
    child(body, "mass", f"{mass:.6g}")
    child(body, "mass_center", _numbers(centre))
    child(body, "inertia", _numbers(inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]))
    return body


def _mass(segment: Segment, parts: Sequence[Part]) -> tuple[float, Array, Array]:
    """Mass, centre (3,) from the joint and inertia (3, 3) about it, of ellipsoids; of a gram without parts."""
    if not parts:
        return 1e-3, np.zeros(3), 1e-6 * np.eye(3)
    sizes = np.array([part.shape.size for part in parts])
    masses = _DENSITY_KG_M3 * 4 / 3 * np.pi * sizes.prod(axis=1)
    places = np.array([part.model_from_part[:3, 3] for part in parts]) - segment.joint
    centre = masses @ places / masses.sum()
    inertia = np.zeros((3, 3))
    for part, mass, size, place in zip(parts, masses, sizes, places - centre, strict=True):
        turn = part.model_from_part[:3, :3]
        own = turn @ np.diag((size @ size - size**2) / 5) @ turn.T
        inertia += mass * (own + place @ place * np.eye(3) - np.outer(place, place))
    return float(masses.sum()), centre, inertia


def _frame(name: str, parent: str, translation: Array, rotation: Array) -> Node:
    frame = Node("PhysicalOffsetFrame", {"name": name})
    child(frame, "socket_parent", parent)
    child(frame, "translation", _numbers(translation))
    child(frame, "orientation", _numbers(euler_angles(rotation, "XYZ")))
    return frame


def _pieces(body: BodyModel, segment: Segment) -> list[list[int]]:
    """The parameters of a segment as joints of OpenSim, outermost first.

    Such a joint slides along up to three independent axes of its parent and then turns about up to three.
    """
    pieces: list[list[int]] = [[]]
    for k in segment.parameters:
        alike = [body.parameters[j].axis for j in pieces[-1] if body.rotates[j] == body.rotates[k]]
        independent = np.linalg.matrix_rank([*alike, body.parameters[k].axis], tol=1e-6) == len(alike) + 1
        if not independent or (not body.rotates[k] and any(body.rotates[j] for j in pieces[-1])):
            pieces.append([])
        pieces[-1].append(k)
    return pieces


def _body_names(body: BodyModel, segment: Segment) -> list[str]:
    """Names of the bodies that a segment's joints move, its own the last."""
    between = len(_pieces(body, segment)) - 1
    name = exported_name(segment.name)
    return [*(f"{name}_between_{k}" for k in range(1, between + 1)), name]


def _joints(body: BodyModel, segment: Segment, names: Sequence[str]) -> Iterator[Node]:
    """The joints of a segment with its parent; that of a root turns z up to OpenSim's y up."""
    if segment.parent < 0:
        before = _frame("parent_offset", "/ground", Y_UP @ segment.joint, Y_UP)
    else:
        parent = body.segments[segment.parent]
        before = _frame(
            "parent_offset", f"/bodyset/{exported_name(parent.name)}", segment.joint - parent.joint, np.eye(3)
        )
    for name, own in zip(names, _pieces(body, segment), strict=True):
        joint = Node("CustomJoint", {"name": f"{name}_joint"})
        child(joint, "socket_parent_frame", "parent_offset")
        child(joint, "socket_child_frame", "child_offset")
        coordinates = child(joint, "coordinates")
        for k in own:
            coordinates.append(_coordinate(body, k))
        frames = child(joint, "frames")
        frames.extend([before, _frame("child_offset", f"/bodyset/{name}", np.zeros(3), np.eye(3))])
        joint.append(_transform(body, own))
        yield joint
        before = _frame("parent_offset", f"/bodyset/{name}", np.zeros(3), np.eye(3))


def _coordinate(body: BodyModel, k: int) -> Node:
    low, high = np.clip(body.limits[k], -_FREE, _FREE)
    coordinate = Node("Coordinate", {"name": exported_name(body.names[k])})
    child(coordinate, "default_value", "0")
    child(coordinate, "range", _numbers([low, high]))
    child(coordinate, "clamped", "false")
    child(coordinate, "locked", "false")
    return coordinate


def _transform(body: BodyModel, parameters: Sequence[int]) -> Node:
    """The axes that the coordinates turn about and slide along, in the order in which they move the body."""
    transform = Node("SpatialTransform")
    for kind, rotates in (("rotation", True), ("translation", False)):
        own = [k for k in parameters if body.rotates[k] == rotates]
        axes = _completed([body.parameters[k].axis for k in own])
        for i, axis in enumerate(axes):
            entry = child(transform, "TransformAxis", name=f"{kind}{i + 1}")
            if i < len(own):
                child(entry, "coordinates", exported_name(body.names[own[i]]))
            child(entry, "axis", _numbers(axis))
            function = child(entry, "LinearFunction" if i < len(own) else "Constant", name="function")
            child(function, *(("coefficients", "1 0") if i < len(own) else ("value", "0")))
    return transform


def _completed(axes: list[Array]) -> list[Array]:
    """Three independent axes, which OpenSim demands, the given ones first."""
    found = list(axes)
    for axis in np.eye(3):
        if np.linalg.matrix_rank([*found, axis], tol=1e-6) == len(found) + 1:
            found.append(axis)
    return found
