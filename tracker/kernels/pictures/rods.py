"""Which pixels of a view lie inside the parts of a body, taken for rods, for many poses."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Array32
from tracker.kernels.compilation import compiled

# A rod seen from its end is a point.
_LEAST_PX2 = np.float32(1e-6)


@compiled
def covered_by_rods(starts: Array32, ways: Array32, reach_px: Array32, pixels: Array32, shares: Array) -> None:
    """Writes the share of some pixels that poses cover.

    Args:
        starts: (B, P, 2) one end of each part, px; NaN covers nothing.
        ways: (B, P, 2) from there to the other end.
        reach_px: (B, P) how far from the line between them a part reaches.
        pixels: (N, 2).
        shares: (B,) written.
    """
    zero, one = np.float32(0), np.float32(1)
    for b in range(len(starts)):
        n_inside = 0
        for i in range(len(pixels)):
            for p in range(starts.shape[1]):
                way_x, way_y = ways[b, p, 0], ways[b, p, 1]
                gap_x, gap_y = pixels[i, 0] - starts[b, p, 0], pixels[i, 1] - starts[b, p, 1]
                along = (gap_x * way_x + gap_y * way_y) / max(way_x * way_x + way_y * way_y, _LEAST_PX2)
                if along < zero:
                    along = zero
                elif along > one:
                    along = one
                gap_x -= along * way_x
                gap_y -= along * way_y
                if gap_x * gap_x + gap_y * gap_y < reach_px[b, p] * reach_px[b, p]:
                    n_inside += 1
                    break
        shares[b] = n_inside / len(pixels)
