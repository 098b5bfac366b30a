"""What a recording is on disk: one stream of images a view, some of which may be absent."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

from tracker.cameras.frame import Packed
from tracker.foundation.arrays import Image
from tracker.foundation.errors import SequenceError
from tracker.images.reading._selection import OnMissing

LEAST_FPS, MOST_FPS = 1e-3, 1e5
"""A picture every quarter of an hour, and the fastest cameras."""

_View = TypeVar("_View")

log = logging.getLogger("tracker")


class ImageStream(Protocol):
    """One view's images, read in ascending order."""

    def read(self, index: int) -> Image | None:
        """Image number `index` of the view's own count, None past its end.

        Raises:
            SequenceError: it cannot be read.
        """
        ...

    def held(self, index: int) -> Image | Packed | None:
        """The same, packed where that takes less memory; see `read`."""
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

    positions: tuple[tuple[int, ...] | None, ...] = ()
    """Of each view, for each image that can be asked for, its position in the file, -1 where it was dropped; None, or
    no views at all: it is what is asked for."""


@dataclass(frozen=True)
class AbsentView:
    """A view whose files are missing or cannot be opened."""

    def read(self, index: int) -> Image | None:
        """None for every frame."""
        return None

    def held(self, index: int) -> Image | Packed | None:
        """None for every frame."""
        return None


def opened_views(names: tuple[str, ...], opened: Callable[[str], _View], on_missing: OnMissing) -> list[_View | None]:
    """What `opened` makes of each view; None for views that cannot be opened, where that is allowed, with a warning.

    Raises:
        SequenceError: from `opened`, where nothing may be missing or no view can be opened.
    """
    views: list[_View | None] = []
    faults: dict[str, SequenceError] = {}
    for name in names:
        try:
            views.append(opened(name))
        except SequenceError as fault:
            views.append(None)
            faults[name] = fault
    if faults and (on_missing == "error" or len(faults) == len(names)):
        raise next(iter(faults.values()))
    for name, why in faults.items():
        log.warning('view "%s" is left out of all frames: %s', name, why)
    return views
