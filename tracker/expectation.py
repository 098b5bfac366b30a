"""Where in the images a scene is expected, from its contours."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array32, Region
from tracker.contours import Contours


def expected_samples(contours: Contours, view: int) -> Array32:
    """Pixel and normal (M, 4) of the samples that are matched, of all poses, in one view."""
    rows = [
        positions[positions[:, 4] > 0, :4]
        for positions in (contours.positions[b, view, : contours.counts[b, view]] for b in range(contours.n_poses))
    ]
    return np.ascontiguousarray(np.concatenate(rows))


def region_around(samples: Array32, size: tuple[int, int], margin_px: float) -> Region:
    """Bounding box of the samples with a margin, inside the image; at least 8 px wide and high."""
    if len(samples) == 0:
        return 0, 0, *size
    low = np.floor(samples[:, :2].min(axis=0) - margin_px).astype(int)
    high = np.ceil(samples[:, :2].max(axis=0) + margin_px).astype(int)
    x, y = (int(np.clip(low[k], 0, size[k] - 8)) for k in range(2))
    return x, y, int(np.clip(high[0], x + 8, size[0])) - x, int(np.clip(high[1], y + 8, size[1])) - y
