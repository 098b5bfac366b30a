"""An opened recording of calibrated cameras: its frames with masks, and what persons stand out against."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Image, Mask
from tracker.images.plate import Plate
from tracker.images.reading._masks import MaskFiles, with_occluders
from tracker.images.reading._plates import RecordedPlate, backdrop, clean_enough
from tracker.images.reading._streaming import OpenViews


@dataclass(frozen=True)
class OpenSequence(OpenViews):
    """An opened recording; see `tracker.images.reading.Sequence`."""

    rig: Rig
    """The cameras of the images as delivered (after downscaling)."""

    given: tuple[Plate | None, ...] | None
    """The plates that the settings ask for; None for those that the recording makes by itself."""

    spread: Callable[[int], list[Image]]
    """Images of a view, by its number, spread over the recording."""

    masks: MaskFiles | None = None
    """Silhouettes that the user brings."""

    occluders: tuple[Mask | None, ...] = ()
    """(h, w) where each view shows what stands before the persons; no views for none at all."""

    @cached_property
    def _recorded(self) -> tuple[RecordedPlate | None, ...]:
        return tuple(backdrop(self.spread(v)) for v in range(len(self.names)))

    @property
    def backdrops(self) -> tuple[Plate | None, ...]:
        """What each view shows most of the time; see `tracker.images.reading.Sequence.backdrops`."""
        return self._occluded(tuple(None if one is None else one.plate for one in self._recorded))

    @property
    def plates(self) -> tuple[Plate | None, ...]:
        """A clean plate for each view that has one; see `tracker.images.reading.Sequence.plates`."""
        return self._occluded(clean_enough(self._recorded)) if self.given is None else self.given

    def _occluded(self, plates: tuple[Plate | None, ...]) -> tuple[Plate | None, ...]:
        return with_occluders(plates, self.occluders) if self.occluders else plates

    @property
    def makes_plates(self) -> bool:
        """Whether plates are its own affair; see `tracker.images.reading.Sequence.makes_plates`."""
        return self.given is None

    @property
    def known(self) -> tuple[Plate | None, ...]:
        """What the persons stand out against in each view: the plate, or nothing (h, w, 3) where masks tell."""
        if self.masks is None:
            return self.plates
        blank = (Plate(np.zeros((height, width, 3), dtype=np.uint8)) for width, height in self.sizes)
        pairs = zip(self.plates, blank, self.masks.files, strict=True)
        return tuple(black if files else plate for plate, black, files in pairs)

    def frames(self) -> Iterator[Frame]:
        """All frames of the selection with their masks; see `OpenViews.frames`."""
        if self.masks is None:
            return super().frames()
        return self._masked(self.masks, super().frames())

    def _masked(self, masks: MaskFiles, frames: Iterator[Frame]) -> Iterator[Frame]:
        for frame in frames:
            read = (masks.read(v, frame.position(v)) for v in range(len(frame.images)))
            shown = zip(frame.images, read, strict=True)
            yield replace(frame, masks=tuple(None if image is None else mask for image, mask in shown))
