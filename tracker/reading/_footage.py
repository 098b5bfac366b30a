"""What a recording is on disk: one stream of images a view, some of which may be absent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

from tracker.arrays import Image
from tracker.errors import SequenceError
from tracker.reading._selection import OnMissing

_View = TypeVar("_View")


class ImageStream(Protocol):
    """One view's images, read in ascending order."""

    def read(self, index: int) -> Image | None:
        """Image number `index` of the view's own count, None past its end.

        Raises:
            SequenceError: it cannot be read.
        """
        ...


@dataclass(frozen=True)
class Footage:
    """What a reading component has found on disk."""

    names: tuple[str, ...]
    """The views in order."""

    fps: float
    lengths: tuple[int, ...]
    """Number of images of each view, 0 where it is absent."""

    open_views: Callable[[], tuple[ImageStream, ...]]
    plate_of_clip: Callable[[Path], Image]
    first: int = 0
    """Number in the file names of the images, or of masks, that belongs to a view's image 0."""


@dataclass(frozen=True)
class AbsentView:
    """A view whose files are missing or cannot be opened."""

    def read(self, index: int) -> Image | None:
        """None for every frame."""
        return None


def opened_views(names: tuple[str, ...], opened: Callable[[str], _View], on_missing: OnMissing) -> list[_View | None]:
    """What `opened` makes of each view; None for views that cannot be opened, where that is allowed.

    Raises:
        SequenceError: from `opened`, where nothing may be missing or no view can be opened.
    """
    views: list[_View | None] = []
    faults: list[SequenceError] = []
    for name in names:
        try:
            views.append(opened(name))
        except SequenceError as fault:
            views.append(None)
            faults.append(fault)
    if faults and (on_missing == "error" or len(faults) == len(names)):
        raise faults[0]
    return views
