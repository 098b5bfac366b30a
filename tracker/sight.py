"""One frame's images before what is known to be there without persons, and what has been found in them so far."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any, TypeVar

from tracker.arrays import Image, Mask
from tracker.frame import Frame
from tracker.imaging.background import Region, changed

_Found = TypeVar("_Found")


@dataclass(frozen=True)
class Changes:
    """What differs from the clean plate of a view; false outside the region looked at."""

    moving: Mask
    """(H, W) all pixels that have changed, shadows included."""

    silhouette: Mask
    """(H, W) the moving foreground."""


class Sight:
    """The images of one frame with the clean plates. Whatever is found in a region of a view is found once.

    Several kinds of evidence share it, and a thread may look ahead in it while the frame before is being estimated.
    """

    def __init__(self, frame: Frame, plates: tuple[Image | None, ...] = ()) -> None:
        """Images and a clean plate for each view that has one; none for no plates at all."""
        self.frame = frame
        self.plates = plates or (None,) * len(frame.images)
        self._found: dict[tuple[Hashable, int], tuple[Region, Any]] = {}

    def once(self, key: Hashable, view: int, region: Region, find: Callable[[Region], _Found]) -> _Found:
        """What was found in a region of a view, or in a larger one before; else it is found now.

        Args:
            key: what is looked for, and how: equal keys find the same.
            view: number of the view.
            region: x, y, width, height, px.
            find: finds it in the region.
        """
        kept = self._found.get((key, view))
        if kept is not None and _covers(kept[0], region):
            found: _Found = kept[1]
            return found
        found = find(region)
        self._found[key, view] = region, found
        return found

    def has(self, key: Hashable, view: int, region: Region) -> bool:
        """Whether something was found in a region of a view already."""
        kept = self._found.get((key, view))
        return kept is not None and _covers(kept[0], region)

    def changes(self, view: int, region: Region) -> Changes | None:
        """What differs from the plate in a region; None where image or plate is missing."""
        image, plate = self.frame.images[view], self.plates[view]
        if image is None or plate is None:
            return None
        return self.once(Changes, view, region, lambda where: Changes(*changed(image, plate, where)))

    def silhouette(self, view: int) -> Mask | None:
        """The moving foreground (H, W) as far as it was looked for; None if it was not, or can't be."""
        kept = self._found.get((Changes, view))
        return None if kept is None else kept[1].silhouette


def _covers(region: Region, other: Region) -> bool:
    """Whether a region contains another one."""
    x, y, width, height = other
    return (
        region[0] <= x and region[1] <= y and x + width <= region[0] + region[2] and y + height <= region[1] + region[3]
    )
