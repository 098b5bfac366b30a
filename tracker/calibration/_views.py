"""What a calibration is made from: synchronized views without a rig yet."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Protocol, runtime_checkable

from tracker.frame import Frame

Told = Callable[[str, int, int], None]
"""Told what is being done, how much of it is done, and how much there is."""


@runtime_checkable
class Views(Protocol):
    """Synchronized images of cameras that are not calibrated."""

    @property
    def names(self) -> tuple[str, ...]:
        """The views in order."""
        ...

    @property
    def sizes(self) -> tuple[tuple[int, int], ...]:
        """Image widths and heights, px."""
        ...

    @property
    def n_frames(self) -> int:
        """Number of frames that `frames()` delivers."""
        ...

    def frames(self) -> Iterator[Frame]:
        """All frames in order; it can be asked for more than once."""
        ...
