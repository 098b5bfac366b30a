"""What region evidence sees of images: colour numbers around the persons, those of texture in monochrome images."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tracker.arrays import Image, Numbers16, Region, frozen
from tracker.imaging.monochrome import is_monochrome, textured
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
    """The colour numbers of a region of an image (h, w, 3); those of grey and texture where it has no colours."""
    codes = np.empty(region[2] * region[3], dtype=np.uint16)
    x, y, width, height = region
    if is_monochrome(image):
        encode(textured(image, region), (0, 0, width, height), codes)
    elif image.flags.c_contiguous and image.flags.writeable:
        encode(image, region, codes)
    else:
        # a copy, so that pictures of every layout are of one type to the compiler
        encode(np.array(image[y : y + height, x : x + width], order="C"), (0, 0, width, height), codes)
    return region, codes
