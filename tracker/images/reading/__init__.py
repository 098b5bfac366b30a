"""Reading: synchronized views from files, streamed frame by frame."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol, runtime_checkable

from tracker.cameras.frame import Frame, Views
from tracker.cameras.rig import Rig
from tracker.images.plate import Plate
from tracker.images.reading._timeline import later

__all__ = ["Reading", "Sequence", "later"]


@runtime_checkable
class Sequence(Protocol):
    """An opened recording; frames are decoded on iteration, so memory stays bounded."""

    @property
    def rig(self) -> Rig:
        """The cameras of the delivered images."""
        ...

    @property
    def n_frames(self) -> int:
        """Number of frames that `frames()` delivers."""
        ...

    @property
    def fps(self) -> float:
        """Frames per second of the recording (before any stride)."""
        ...

    @property
    def interval_s(self) -> float:
        """Usual time from one delivered frame to the next, seconds, including the stride."""
        ...

    @property
    def plates(self) -> tuple[Plate | None, ...]:
        """A clean plate for each view that has one, else None."""
        ...

    @property
    def known(self) -> tuple[Plate | None, ...]:
        """Background of persons in each view: a plate, or nothing if there are masks; None for neither."""
        ...

    @property
    def backdrops(self) -> tuple[Plate | None, ...]:
        """Most frequent colours of each view, made from the recording on first use.

        Unknown where no colour is frequent; a person who never moves is part of it. None for a view with too few
        images, without movement, or with movement everywhere.
        """
        ...

    @property
    def makes_plates(self) -> bool:
        """Whether the recording decides on plates: the configuration names no plates or masks, nor refuses plates."""
        ...

    def frames(self) -> Iterator[Frame]:
        """All frames of the chosen range in order."""
        ...


@runtime_checkable
class Reading(Protocol):
    """A component that opens a recording."""

    def open(self) -> Sequence:
        """Opens all views.

        Raises:
            SequenceError: files are missing, corrupt or do not belong together.
            CalibrationError: the rig is impossible or does not fit the images.
        """
        ...

    def open_uncalibrated(self) -> Views:
        """Opens the views of cameras to be calibrated: `views` names them, and no rig is needed.

        Raises:
            SequenceError: files are missing, corrupt or do not belong together.
        """
        ...
