"""What differs between an image and a plate, and which regions of it are large enough to be an object."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tracker.arrays import Image
from tracker.kernels.compilation import compiled


@compiled
def mark_changes(image: Image, plate: Image, origin: tuple[int, int], level: float, moving: Image) -> None:
    """Marks the pixels where a channel differs by more than a level.

    Args:
        image: (h + 2, w + 2, 3) a part of the image with a border of a pixel, which is left out.
        plate: (H, W, 3) the whole plate.
        origin: pixel (x, y) of the part's upper left corner, without the border.
        level: grey levels.
        moving: (h, w) output: 1 at such pixels, 0 elsewhere.
    """
    height, width = moving.shape
    most = np.int16(min(level, 255.0))
    for y in range(height):
        row = plate[y + origin[1], origin[0] : origin[0] + width]
        _mark_row(image[y + 1, 1:-1].reshape(-1), row.reshape(-1), most, moving[y])


@compiled
def _mark_row(row: Image, plate: Image, most: np.int16, moving: Image) -> None:
    # Operators would widen the numbers to 64 bits.
    for x in range(len(moving)):
        blue = np.absolute(np.subtract(np.int16(row[3 * x]), np.int16(plate[3 * x])))
        green = np.absolute(np.subtract(np.int16(row[3 * x + 1]), np.int16(plate[3 * x + 1])))
        red = np.absolute(np.subtract(np.int16(row[3 * x + 2]), np.int16(plate[3 * x + 2])))
        moving[x] = (blue > most) | (green > most) | (red > most)


@compiled
def median_level(picture: Image) -> float:
    """Median of the grey levels of a picture (h, w)."""
    counts = np.zeros(256, dtype=np.int64)
    for row in picture:
        for level in row:
            counts[level] += 1
    n = counts.sum()
    total = 0
    for rank in ((n - 1) // 2, n // 2):
        least, below = 0, counts[0]
        while below <= rank and least < 255:
            least += 1
            below += counts[least]
        total += least
    return 0.5 * total


@compiled
def large_regions(labels: NDArray[np.int32], n_labels: int, least: float, mask: NDArray[np.bool_]) -> None:
    """Marks the regions that are not much smaller than the largest one.

    Args:
        labels: (h, w) number of each pixel's region, 0 for none.
        n_labels: number of regions and one.
        least: share of the largest region's area.
        mask: (h, w) output.
    """
    height, width = labels.shape
    areas = np.zeros(n_labels, dtype=np.int64)
    for y in range(height):
        for x in range(width):
            areas[labels[y, x]] += 1
    areas[0] = 0
    kept = areas >= max(least * areas.max(), 1.0)
    for y in range(height):
        for x in range(width):
            mask[y, x] = kept[labels[y, x]]
