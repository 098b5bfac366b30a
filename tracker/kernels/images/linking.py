"""Edge linking: chains of neighbouring edge pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tracker.arrays import Image
from tracker.kernels.compilation import compiled

Pixels = NDArray[np.int32]
"""(N, 2) x, y; or (N,) indices. Half the memory traffic of `Integers`."""

# Columns and rows from a pixel to its neighbours, in the order in which a chain goes on: straight ones first.
_RIGHT = 1, 0, -1, 0, 1, -1, -1, 1
_DOWN = 0, 1, 0, -1, 1, 1, -1, -1


@compiled
def link_edges(edges: Image, points: Pixels, starts: Pixels) -> int:
    """Links edge pixels into 8-connected chains; each pixel belongs to one chain.

    Args:
        edges: (h + 2, w + 2) non-zero at edge pixels, with an empty border, contiguous; cleared by the linking.
        points: (N, 2) output: x, y of all edge pixels, without the border, chain after chain.
        starts: (N + 1,) output: first point of each chain.

    Returns:
        Number of chains.
    """
    width = edges.shape[1]
    flat = edges.reshape(-1)
    # Most pixels are no edges: eight at a time are passed over.
    eights = flat[: flat.size // 8 * 8].view(np.uint64)
    n_chains = n = 0
    for word in range(len(eights) + 1):
        if word < len(eights) and eights[word] == 0:
            continue
        for place in range(8 * word, min(8 * word + 8, flat.size)):
            if flat[place]:
                starts[n_chains] = n
                n = _link_chain(flat, width, place, points, n)
                n_chains += 1
    starts[n_chains] = n
    return n_chains


@compiled
def _link_chain(flat: Image, width: int, place: int, points: Pixels, n: int) -> int:
    """Writes the chain through one pixel to the points from n on; returns its end."""
    begin = n
    n = _walk(flat, width, place, points, n)
    k = _next_neighbour(flat, width, place)
    if k < 0:
        return n
    low, high = begin, n - 1
    while low < high:
        for axis in range(2):
            points[low, axis], points[high, axis] = points[high, axis], points[low, axis]
        low, high = low + 1, high - 1
    return _walk(flat, width, place + _DOWN[k] * width + _RIGHT[k], points, n)


@compiled
def _walk(flat: Image, width: int, place: int, points: Pixels, n: int) -> int:
    """Writes the pixels from one on in one direction, and clears them."""
    # Once: dividing each place by the width would take as long as all else.
    y = place // width
    x, k = place - y * width, 0
    while k >= 0:
        flat[place] = 0
        points[n, 0], points[n, 1] = x - 1, y - 1
        n += 1
        k = _next_neighbour(flat, width, place)
        if k >= 0:
            place, x, y = place + _DOWN[k] * width + _RIGHT[k], x + _RIGHT[k], y + _DOWN[k]
    return n


@compiled
def _next_neighbour(flat: Image, width: int, place: int) -> int:
    """Number of the first unvisited neighbour; -1 if there is none."""
    for k in range(8):
        if flat[place + _DOWN[k] * width + _RIGHT[k]]:
            return k
    return -1
