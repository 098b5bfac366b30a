"""Synthesis: what the model looks like in every view."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from tracker.arrays import Array, Mask
from tracker.contours import Contours
from tracker.scene import Scene


@runtime_checkable
class Synthesis(Protocol):
    """A component that projects a scene into all views."""

    def contours(self, scene: Scene, person: int | None = None, poses: Array | None = None) -> Contours:
        """Visible occluding contours of all persons, with many poses of one person tried at once.

        Args:
            scene: persons, poses and rig.
            person: whose poses vary; None for the scene as it is.
            poses: (B, dof) of that person, rad and m.

        Returns:
            Samples for B poses (1 for the scene as it is) and all views.
        """
        ...

    def silhouettes(self, scene: Scene) -> tuple[Mask, ...]:
        """The region (H, W) that all persons cover, for each view."""
        ...
