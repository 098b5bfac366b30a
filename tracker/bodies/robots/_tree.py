"""Links as a description nests them, put together to a robot: fixed ones joined, all places in the world."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.bodies.robots import Joint, Link, Robot
from tracker.bodies.skin_files import ScannedSurface
from tracker.foundation.arrays import Array

_FREE_LIMIT = 200 * np.pi
"""Of a joint that turns without end, rad."""


@dataclass(frozen=True)
class NestedJoint:
    """A joint in the frame of the link that it moves."""

    name: str
    rotates: bool
    axis: Array
    point: Array = field(default_factory=lambda: np.zeros(3))
    limits: tuple[float, float] = (-_FREE_LIMIT, _FREE_LIMIT)


@dataclass(frozen=True)
class Nested:
    """A link in the frame of its parent."""

    name: str
    parent: str
    """Empty for the world."""

    placement: Array
    """(4, 4) of its frame in that of its parent, where the joints are zero."""

    joints: tuple[NestedJoint, ...] = ()
    surfaces: tuple[ScannedSurface, ...] = ()
    """In its frame, metres."""


def placed(xyz: Sequence[float] | Array, rotation: Rotation) -> Array:
    """(4, 4) of a place and a rotation."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation.as_matrix(), xyz
    return matrix


def moved(surface: ScannedSurface, placement: Array) -> ScannedSurface:
    """A surface in another frame."""
    return ScannedSurface(surface.points @ placement[:3, :3].T + placement[:3, 3], surface.faces)


def joined(surfaces: Sequence[ScannedSurface]) -> ScannedSurface | None:
    """Several surfaces as one; None for none."""
    if not surfaces:
        return None
    firsts = np.cumsum([0, *(len(one.points) for one in surfaces[:-1])])
    faces = np.concatenate([one.faces + first for one, first in zip(surfaces, firsts, strict=True)])
    return ScannedSurface(np.concatenate([one.points for one in surfaces]), faces)


def assembled(name: str, nested: Sequence[Nested], free: bool, unread: Sequence[str]) -> Robot:
    """The robot of links that are told parents first; those without joints are part of what they hang on."""
    frames: dict[str, Array] = {"": np.eye(4)}
    owners: dict[str, int] = {"": -1}
    surfaces: dict[int, list[ScannedSurface]] = {-1: []}
    moving: list[tuple[Nested, int, Array]] = []
    for link in nested:
        frames[link.name] = frames[link.parent] @ link.placement
        owner = owners[link.parent]
        if link.joints:
            moving.append((link, owner, frames[link.name]))
            owner = len(moving) - 1
        owners[link.name] = owner
        surfaces.setdefault(owner, []).extend(moved(one, frames[link.name]) for one in link.surfaces)
    links = tuple(
        Link(link.name, parent, tuple(_in_world(joint, frame) for joint in link.joints), joined(surfaces.get(k, [])))
        for k, (link, parent, frame) in enumerate(moving)
    )
    base = next((link.name for link in nested if owners[link.name] == -1), "base")
    point = frames.get(base, np.eye(4))[:3, 3]
    return Robot(name, base, point, free, joined(surfaces[-1]), links, tuple(unread))


def _in_world(joint: NestedJoint, frame: Array) -> Joint:
    axis = frame[:3, :3] @ (joint.axis / np.linalg.norm(joint.axis))
    return Joint(joint.name, joint.rotates, axis, frame[:3, :3] @ joint.point + frame[:3, 3], joint.limits)


def mimicking(names: Mapping[str, str]) -> list[str]:
    """What is said of joints that follow others, each by the name of the one it follows."""
    return [f'joint "{name}" follows "{other}" there, here it moves by itself' for name, other in names.items()]
