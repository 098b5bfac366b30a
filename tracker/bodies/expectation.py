"""Where in the images a scene is expected, from its contours."""

from __future__ import annotations

import numpy as np

from tracker.bodies.contours import Contours, bounding_box
from tracker.foundation.arrays import Array32, Region


def expected_samples(contours: Contours, view: int) -> Array32:
    """Pixel and normal (M, 4) of the samples that are matched, of all poses, in one view."""
    return contours.matched[view]


def expected_region(contours: Contours, view: int, size: tuple[int, int], margin_px: float) -> Region:
    """The region around the samples that are matched, of all poses, in one view; see `region_around`."""
    return _region(contours.boxes[view], size, margin_px)


def region_around(samples: Array32, size: tuple[int, int], margin_px: float) -> Region:
    """Bounding box of the samples with a margin, inside the image; at least 8 px wide and high."""
    return _region(bounding_box(samples), size, margin_px)


def _region(box: Array32 | None, size: tuple[int, int], margin_px: float) -> Region:
    if box is None:
        return 0, 0, *size
    left, top = np.floor(box[0] - margin_px).astype(int).tolist()
    right, bottom = np.ceil(box[1] + margin_px).astype(int).tolist()
    x, y = min(max(left, 0), size[0] - 8), min(max(top, 0), size[1] - 8)
    return x, y, min(max(right, x + 8), size[0]) - x, min(max(bottom, y + 8), size[1]) - y
