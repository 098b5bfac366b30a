"""Robots and animals as descriptions for simulators: a tree of links, joints with limits, visible shapes."""

from __future__ import annotations

from dataclasses import dataclass

from tracker.bodies.skin import ScannedSurface
from tracker.foundation.arrays import Array


@dataclass(frozen=True)
class Joint:
    """One degree of freedom, where all are zero."""

    name: str
    rotates: bool
    axis: Array
    """(3,) unit vector in the world."""

    point: Array
    """(3,) on the axis, in the world, metres."""

    limits: tuple[float, float]
    """rad or m; infinite where free."""


@dataclass(frozen=True)
class Link:
    """What moves as one: a link with those that are fixed to it."""

    name: str
    parent: int
    """Number of the link it hangs on, always a smaller one; -1 for what carries all of them, the base or the world."""

    joints: tuple[Joint, ...]
    """Outermost first, one at least."""

    surface: ScannedSurface | None
    """What is seen of it, in the world, where all joints are zero; None for nothing."""


@dataclass(frozen=True)
class Robot:
    """A robot where all of its joints are zero."""

    name: str
    base: str
    """What the link is called that carries all others."""

    base_point: Array
    """(3,) origin of that link's frame, in the world, metres."""

    free: bool
    """Whether the description says that the base moves about."""

    base_surface: ScannedSurface | None
    links: tuple[Link, ...]
    """Parents first."""

    unread: tuple[str, ...]
    """What of the description is not, or otherwise, in this, a sentence each."""
