"""A frame: the synchronized images of all views at one time instant."""

from __future__ import annotations

from dataclasses import dataclass

from tracker.arrays import Image, Mask


@dataclass(frozen=True)
class Frame:
    """Synchronized images of all V views."""

    index: int
    """Position in the sequence, counted in frames of the reference view."""

    time_s: float
    """Time since frame 0, seconds."""

    images: tuple[Image | None, ...]
    """One BGR image `(h, w, 3)` a view, in the rig's order; None where that view is missing."""

    masks: tuple[Mask | None, ...] = ()
    """Silhouettes `(h, w)` of the persons that the user brings; empty for none, None where a view has none."""

    positions: tuple[int, ...] = ()
    """Of each view's image among all that it has, from 0 on; empty where they are the frame's, negative for none."""

    first_number: int = 0
    """That the file name of an image at position 0 has."""

    def position(self, view: int) -> int:
        """Of a view's image among all that it has, from 0 on."""
        return self.positions[view] if self.positions else self.index

    def mask(self, view: int) -> Mask | None:
        """The silhouette that the user brings for a view."""
        return self.masks[view] if self.masks else None

    @property
    def missing(self) -> tuple[int, ...]:
        """Indices of the views without an image."""
        return tuple(v for v, image in enumerate(self.images) if image is None)
