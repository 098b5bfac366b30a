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
    """An opened recording; frames are decoded while they are iterated, so memory stays bounded."""

    @property
    def rig(self) -> Rig:
        """The cameras of the images as delivered."""
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
        """Usual time from one delivered frame to the next, seconds, the stride included."""
        ...

    @property
    def plates(self) -> tuple[Plate | None, ...]:
        """A clean plate for each view that has one, else None."""
        ...

    @property
    def known(self) -> tuple[Plate | None, ...]:
        """What persons stand out against in each view: a plate, or nothing where masks tell; None for neither."""
        ...

    @property
    def backdrops(self) -> tuple[Plate | None, ...]:
        """What each view shows most of the time, made of the recording when first asked for.

        Unknown where nothing is shown for long; somebody who never moves is part of it. None for a view of too few
        images, in which nothing moves, or everything.
        """
        ...

    @property
    def makes_plates(self) -> bool:
        """Whether plates are the recording's own affair: neither plates nor masks are told, nor that there are none."""
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
            CalibrationError: the rig cannot be right or does not fit the images.
        """
        ...

    def open_uncalibrated(self) -> Views:
        """Opens the views of cameras that are to be calibrated: no rig is needed, `views` names them.

        Raises:
            SequenceError: files are missing, corrupt or do not belong together.
        """
        ...
