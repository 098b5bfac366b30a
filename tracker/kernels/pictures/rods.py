"""Which pixels of a view lie inside the parts of a body, taken for rods, for many poses."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array, Array32


def covered_by_rods(starts: Array32, ways: Array32, reach_px: Array32, pixels: Array32, shares: Array) -> None:
    """Writes the share of some pixels that poses cover.

    Args:
        starts: (B, P, 2) one end of each part, px; NaN covers nothing.
        ways: (B, P, 2) from there to the other end.
        reach_px: (B, P) how far from the line between them a part reaches.
        pixels: (N, 2).
        shares: (B,) written.
    """
    native.covered_by_rods(starts, ways, reach_px, pixels, shares)
