"""What region evidence sees of images: numbers of what their pixels around the persons look like."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tracker.arrays import Image, Numbers16, Region, frozen
from tracker.imaging.appearance import appearance
from tracker.kernels.regions.colours import Picture, encode

Codes = tuple[Region, Numbers16]
"""A region of a view and its colour numbers, row by row."""


def packed(views: Sequence[Codes | None]) -> Picture:
    """The colour numbers of all views; None for a missing one."""
    codes, layout, start = [np.zeros(0, dtype=np.uint16)], [], 0
    for view in views:
        region, numbers = view or ((0, 0, 0, 0), codes[0])
        layout.append((start, *region))
        codes.append(numbers)
        start += len(numbers)
    flat: Numbers16 = np.concatenate(codes)
    flat.setflags(write=False)
    return Picture(flat, frozen(layout, np.int64))


def encoded(image: Image, region: Region) -> Codes:
    """The numbers of what a region of an image (h, w, 3) looks like."""
    codes = np.empty(region[2] * region[3], dtype=np.uint16)
    encode(appearance(image, region), codes)
    return region, codes
