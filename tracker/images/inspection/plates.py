"""Plates that show a person: the images lack the person, so the place stays foreground for ever."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import pydantic

from tracker.foundation.arrays import Array, Image, Mask
from tracker.foundation.configuration.components import component
from tracker.images.inspection import Survey
from tracker.images.inspection._survey import FACTOR

# Frames in which a region may be hidden by who walks past.
_ALWAYS = 0.95


@component
class PlatesInspection:
    """Finds regions that are foreground in nearly every frame, with a contour in the plate and none in the images.

    A person who stands in one place is always foreground too, but then the contour is in the images.
    """

    least_share: float = pydantic.Field(default=0.004, gt=0, lt=1)
    """Size of such a region, as a share of the image."""

    sharper: float = pydantic.Field(default=1.5, gt=0)
    """Factor by which the gradients at its border are larger in the plate than in the images."""

    def findings(self, seen: Survey) -> Iterator[str]:
        """See `tracker.images.inspection.Inspection.findings`."""
        for v, (name, plate, picture) in enumerate(zip(seen.rig.names, seen.plates, seen.pictures, strict=True)):
            masks = [row[v] for row in seen.foregrounds]
            there = [mask for mask in masks if mask is not None]
            if plate is None or picture is None or not there:
                continue
            always = np.mean(there, axis=0) > _ALWAYS
            for x, y in self._ghosts(always, plate.picture, picture):
                yield (
                    f'the plate of view "{name}" shows something at pixel ({x:.0f}, {y:.0f}) that its images lack: '
                    "a person when it was taken? Take one without persons"
                )

    def _ghosts(self, always: Mask, plate: Image, picture: Image) -> Iterator[tuple[float, float]]:
        """Middles of regions with a contour only in the plate, px of the whole image."""
        count, labels, stats, middles = cv2.connectedComponentsWithStats(always.astype(np.uint8))
        for label in range(1, count):
            if stats[label, cv2.CC_STAT_AREA] < self.least_share * always.size:
                continue
            region = (labels == label).astype(np.uint8)
            border = cv2.dilate(region, np.ones((5, 5))) - cv2.erode(region, np.ones((5, 5))) > 0
            if _steepness(plate)[border].mean() > self.sharper * _steepness(picture)[border].mean():
                x, y = FACTOR * middles[label] + (FACTOR - 1) / 2
                yield float(x), float(y)


def _steepness(picture: Image) -> Array:
    """Size of the grey gradient (h, w)."""
    grey = cv2.GaussianBlur(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), (3, 3), 0)
    size: Array = np.hypot(cv2.Sobel(grey, cv2.CV_64F, 1, 0), cv2.Sobel(grey, cv2.CV_64F, 0, 1))
    return size
