"""What differs between an image and a plate, and which regions of it are large enough to be an object."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import tracker._native as native
from tracker.foundation.arrays import Image


def mark_changes(image: Image, plate: Image, origin: tuple[int, int], level: float, moving: Image) -> None:
    """Marks the pixels where a channel differs by more than a level.

    Args:
        image: (h + 2, w + 2, 3) a part of the image with a border of a pixel, which is left out.
        plate: (H, W, 3) the whole plate.
        origin: pixel (x, y) of the part's upper left corner, without the border.
        level: grey levels.
        moving: (h, w) output: 1 at such pixels, 0 elsewhere.
    """
    native.mark_changes(image, plate, origin, level, moving)


def median_level(picture: Image) -> float:
    """Median of the grey levels of a picture (h, w)."""
    return native.median_level(picture)


def large_regions(labels: NDArray[np.int32], n_labels: int, least: float, mask: NDArray[np.bool_]) -> None:
    """Marks the regions that are not much smaller than the largest one.

    Args:
        labels: (h, w) number of each pixel's region, 0 for none.
        n_labels: number of regions and one.
        least: share of the largest region's area.
        mask: (h, w) output.
    """
    native.large_regions(labels, n_labels, least, mask)
