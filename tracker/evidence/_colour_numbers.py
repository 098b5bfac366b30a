"""What region evidence sees of images: numbers of what their pixels around the persons look like."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from tracker.bodies.contours import Contours, expected_region
from tracker.foundation.arrays import Array, Image, Numbers16, Region, frozen
from tracker.images.operations.appearance import appearance
from tracker.images.sight import Sight
from tracker.kernels.regions import Picture, encode

Codes = tuple[Region, Numbers16]
"""A region of a view and its colour numbers, row by row."""


def picture_around(sight: Sight, around: Contours | None, margin: float, least_px: Array | None = None) -> Picture:
    """The colour numbers of all views around some contours, joined; see `colour_numbers`."""
    picture: Picture = sight.joined(encoded, colour_numbers(sight, around, margin, least_px), packed)
    return picture


def colour_numbers(
    sight: Sight, around: Contours | None, margin: float, least_px: Array | None = None
) -> tuple[Codes | None, ...]:
    """The colour numbers of each view near some contours.

    Args:
        sight: the images, in which they are found once.
        around: the contours; None for everywhere.
        margin: as a share of an image's longer side.
        least_px: (V,) margins where they are wider than that.

    Returns:
        For each view its region and numbers, None where its image is missing.
    """
    found: list[Codes | None] = []
    for v, image in enumerate(sight.frame.images):
        if image is None:
            found.append(None)
            continue
        size = image.shape[1], image.shape[0]
        margin_px = max(margin * max(size), 0.0 if least_px is None else float(least_px[v]))
        region = (0, 0, *size) if around is None else expected_region(around, v, size, min(margin_px, max(size)))
        found.append(sight.once(encoded, v, region, partial(encoded, image)))
    return tuple(found)


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
