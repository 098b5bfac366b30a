"""Synchronized views of cameras that have no calibration yet."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol, runtime_checkable

from tracker.cameras.frame import Frame


@runtime_checkable
class Views(Protocol):
    """Opened views: what a calibration is made from."""

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
        """All frames of the chosen range in order; it can be asked for more than once."""
        ...
