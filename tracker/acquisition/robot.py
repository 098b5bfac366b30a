"""A body of a robot's description: segments and limits of its joints, a skin of its meshes, parts fitted to them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.acquisition.scan_rigging import Fitted, fit_superquadric
from tracker.bodies.body.description import BodyDescription
from tracker.bodies.body.entries import AxisEntry, PartEntry, SegmentEntry, Vector
from tracker.bodies.body.sections import SkinSection
from tracker.bodies.robots import Joint, Link, Robot
from tracker.bodies.skin import Rigging, ScannedSurface
from tracker.foundation.arrays import Array, Integers
from tracker.foundation.configuration.components import FilePath, component
from tracker.foundation.errors import ModelError

_N_POINTS = 600
"""Spread over a link's surface, to fit a superquadric to."""

_WORLD = "world"

_ROOT = (
    *(("x", (1.0, 0.0, 0.0), False), ("y", (0.0, 1.0, 0.0), False), ("z", (0.0, 0.0, 1.0), False)),
    *(("roll", (1.0, 0.0, 0.0), True), ("pitch", (0.0, 1.0, 0.0), True), ("yaw", (0.0, 0.0, 1.0), True)),
)
"""Parameters of a base that moves about: along the axes, then about them."""

_ROOT_LIMITS = {"roll": 180.0, "pitch": 89.0, "yaw": 36000.0}
"""Degrees either way, as of the bundled models; places have 100 m either way."""

_SMALLEST_M = 0.002
"""Half extent of a part: plates and wires are thinner than a superquadric can be seen."""


@component
class RobotFile:
    """A robot's description, and how it stands before the cameras."""

    file: FilePath
    """URDF, or MJCF of MuJoCo."""

    base: Literal["free", "fixed"] | None = None
    """`free`: it moves about, as an animal does; `fixed`: its base stays in place, as that of most arms. None: what the
    description says, `fixed` where it says nothing."""

    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position of the origin of a fixed robot's description in the world of the calibration, metres."""

    turn_deg: float = 0.0
    """Turn of a fixed robot about the vertical."""


@dataclass(frozen=True)
class RobotBody:
    """A body, its surface where all joints are zero, and what each part was fitted with."""

    description: BodyDescription
    surface: ScannedSurface
    rigging: Rigging
    skin: SkinSection
    fits: dict[str, Fitted]


def body_of(robot: Robot, name: str, free: bool, placement: Array) -> RobotBody:
    """The body of a robot.

    Args:
        robot: as described.
        name: of the model.
        free: whether its base moves about.
        placement: (4, 4) of the description's world in ours, for a base that stays where it is.

    Raises:
        ModelError: it has no joints, or nothing of it is visible.
    """
    if not robot.links and not free:
        raise ModelError(f'robot "{robot.name}" has no joints that move, expected one at least')
    base = robot.base if free else _WORLD
    shown = [(base, robot.base_surface, np.zeros(3)), *((link.name, link.surface, _at(link)) for link in robot.links)]
    visible = [(owner, surface, joint) for owner, surface, joint in shown if surface is not None]
    if not visible:
        raise ModelError(f'robot "{robot.name}" has no shape that can be read')
    turn, shift = placement[:3, :3], placement[:3, 3]
    surfaces = [ScannedSurface(surface.points @ turn.T + shift, surface.faces) for _, surface, _ in visible]
    fits = {
        _part(owner, robot): _fitted(surface, turn @ joint + shift)
        for (owner, _, joint), surface in zip(visible, surfaces, strict=True)
    }
    parts = tuple(_entry(part, owner, fit) for (owner, _, _), (part, fit) in zip(visible, fits.items(), strict=True))
    segments = (*_root(base, turn @ robot.base_point + shift, free), *_segments(robot, base, turn, shift))
    description = BodyDescription(
        name=name,
        about=f"{len(segments)} segments of the robot {robot.name}",
        sides=("left", "right"),
        segments=segments,
        parts=parts,
    )
    surface, labels = _joined(surfaces)
    rigging = Rigging(tuple(fits), np.eye(len(fits))[labels])
    skin = SkinSection(surface="", smooth=False)
    return RobotBody(description.with_marks(), surface, rigging, skin, fits)


def _at(link: Link) -> Array:
    return link.joints[-1].point


def _part(owner: str, robot: Robot) -> str:
    return robot.base if owner == _WORLD else owner


def _root(base: str, point: Array, free: bool) -> Iterator[SegmentEntry]:
    if free:
        axes = tuple(
            AxisEntry(name=f"{base}_{word}", axis=axis, limits_deg=(-_ROOT_LIMITS[word], _ROOT_LIMITS[word]))
            if rotates
            else AxisEntry(name=f"{base}_{word}", axis=axis, limits_m=(-100.0, 100.0))
            for word, axis, rotates in _ROOT
        )
        yield SegmentEntry(name=base, joint=vector(point), parameters=axes)


def _segments(robot: Robot, base: str, turn: Array, shift: Array) -> Iterator[SegmentEntry]:
    """A segment a link; of a link whose joints lie apart, one for each of those joints before the last as well."""
    for link in robot.links:
        parent = base if link.parent < 0 else robot.links[link.parent].name
        groups: list[list[Joint]] = []
        for joint in link.joints:
            apart = groups and not np.allclose(groups[-1][-1].point, joint.point, atol=1e-9)
            if not groups or apart:
                groups.append([])
            groups[-1].append(joint)
        for k, joints in enumerate(groups):
            name = link.name if k == len(groups) - 1 else f"{link.name}_{joints[-1].name}"
            axes = tuple(_axis(joint, turn) for joint in joints)
            at = vector(turn @ joints[0].point + shift)
            yield SegmentEntry(name=name, parent=parent, joint=at, parameters=axes)
            parent = name


def _axis(joint: Joint, turn: Array) -> AxisEntry:
    axis = vector(turn @ joint.axis)
    if joint.rotates:
        low, high = np.degrees(joint.limits)
        return AxisEntry(name=joint.name, axis=axis, limits_deg=(float(low), float(high)))
    return AxisEntry(name=joint.name, axis=axis, limits_m=joint.limits)


def _fitted(surface: ScannedSurface, joint: Array) -> Fitted:
    """A superquadric around a link, along where it is longest, from its joint on."""
    points, weights = _spread(surface)
    centre = np.average(points, axis=0, weights=weights)
    ways = np.linalg.svd((points - centre) * np.sqrt(weights)[:, None], full_matrices=False)[2]
    axis = ways[0] if (centre - joint) @ ways[0] >= 0 else -ways[0]
    return fit_superquadric(points, weights, axis, ways[1])


def _spread(surface: ScannedSurface) -> tuple[Array, Array]:
    """Points (N, 3) even over a surface, the same ones each time, and how much of it each stands for."""
    corners = surface.points[surface.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    if not areas.sum() > 0:
        raise ModelError("a shape of no area")
    rng = np.random.default_rng(0)
    chosen = np.searchsorted(np.cumsum(areas) / areas.sum(), (np.arange(_N_POINTS) + 0.5) / _N_POINTS)
    shares = rng.dirichlet(np.ones(3), _N_POINTS)
    points = np.einsum("nk,nkj->nj", shares, corners[np.minimum(chosen, len(corners) - 1)])
    return points, np.ones(_N_POINTS)


def _entry(part: str, owner: str, fit: Fitted) -> PartEntry:
    """The entry of a part; `part_of` makes the same placement of it again."""
    rotation, middle = fit.placement[:3, :3], fit.placement[:3, 3]
    size = np.maximum(fit.shape[:3], _SMALLEST_M)
    half = size[2] * rotation[:, 2]
    return PartEntry(
        name=part,
        segment=owner,
        start=vector(middle - half),
        end=vector(middle + half),
        radii=(float(size[0]), float(size[1])),
        squareness=(float(fit.shape[3]), float(fit.shape[4])),
        taper=(float(fit.shape[5]), float(fit.shape[6])),
        front=vector(rotation[:, 0]),
    )


def vector(values: Array) -> Vector:
    """Three numbers as an entry of a model file has them."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def _joined(surfaces: list[ScannedSurface]) -> tuple[ScannedSurface, Integers]:
    """All surfaces as one, and (N,) the number of the one that each point is of."""
    firsts = np.cumsum([0, *(len(one.points) for one in surfaces[:-1])])
    faces = np.concatenate([one.faces + first for one, first in zip(surfaces, firsts, strict=True)])
    labels = np.repeat(np.arange(len(surfaces)), [len(one.points) for one in surfaces])
    return ScannedSurface(np.concatenate([one.points for one in surfaces]), faces), labels


def stands_at(at: tuple[float, float, float], turn_deg: float) -> Array:
    """(4, 4) of a description's world that stands at a place, turned about the vertical."""
    placement = np.eye(4)
    placement[:3, :3] = Rotation.from_euler("z", turn_deg, degrees=True).as_matrix()
    placement[:3, 3] = at
    return placement
