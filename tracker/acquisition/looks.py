"""Looks: what the cameras of one moment show of a person."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tracker.acquisition.clouds import Cloud
from tracker.bodies.contours import Contours
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Integers
from tracker.images.observation import Observation


@dataclass(frozen=True)
class Mark:
    """A joint clicked in a picture."""

    landmark: int
    view: int
    pixel: Array
    """(2,) px."""


@dataclass(frozen=True)
class Look:
    """What the cameras of one moment show of the person."""

    rig: Rig
    columns: Integers
    """(dof,) where the pose is among all pose values: looks can share joint angles."""

    outlines: Observation | None = None
    """Outlines of the silhouettes."""

    edges: Callable[[Contours], Observation] | None = None
    """Edges that are accepted, given the expected contours."""

    marks: tuple[Mark, ...] = ()

    cloud: Cloud | None = None
    """Points measured on its surface."""
