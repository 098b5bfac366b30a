"""Edge linking: chains of neighbouring edge pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import tracker._native as native
from tracker.foundation.arrays import Image

Pixels = NDArray[np.int32]
"""(N, 2) x, y; or (N,) indices. Half the memory traffic of `Integers`."""


def link_edges(edges: Image, points: Pixels, starts: Pixels) -> int:
    """Links edge pixels into 8-connected chains; each pixel belongs to one chain.

    Args:
        edges: (h + 2, w + 2) non-zero at edge pixels, with an empty border, contiguous; cleared by the linking.
        points: (N, 2) output: x, y of all edge pixels, without the border, chain after chain.
        starts: (N + 1,) output: first point of each chain.

    Returns:
        Number of chains.
    """
    return native.link_edges(edges, points, starts)
