"""Edge segments that matter, from linked pixels (Gavrila & Davis 1996, section 4.2)."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array32, Image, Integers
from tracker.kernels.compilation import compiled
from tracker.kernels.images.constant_curvature import split_segments
from tracker.kernels.images.linking import Pixels, link_edges
from tracker.kernels.images.profiles import edge_profile
from tracker.kernels.images.slopes import Slopes


@compiled
def trace_segments(
    edges: Image,
    slopes: tuple[Slopes, Slopes],
    rule: tuple[int, float, int],
    near: Image,
    found: tuple[Array32, Array32, Integers],
) -> tuple[int, int]:
    """Links edge pixels, splits the chains and finds the sub-pixel profile of the segments that are long enough.

    Segments that matter to nobody are left out early: four of five edges around a person are the room's.

    Args:
        edges: (h + 2, w + 2) non-zero at the N edge pixels, with an empty border; cleared.
        slopes: dx, dy (h, w) image gradient.
        rule: see `split_segments`.
        near: (h, w) non-zero where edges matter: segments without such a pixel are left out; (0, 0) for all of them.
        found: output: positions (N, 2) px, unit gradients (N, 2) and segments (N,).

    Returns:
        Number of points of segments, which stand first in the output, and number of segments.
    """
    positions, directions, kept = found
    points = np.empty((len(positions), 2), dtype=np.int32)
    starts = np.empty(len(positions) + 1, dtype=np.int32)
    labels = np.empty(len(positions), dtype=np.int32)
    n_chains = link_edges(edges, points, starts)
    n_chains = _chains_near(points, starts, n_chains, near)
    n_pixels = starts[n_chains]
    split_segments(points, starts, n_chains, rule, labels)
    n = n_segments = i = 0
    while i < n_pixels:
        end = i + 1
        while end < n_pixels and labels[end] == labels[i]:
            end += 1
        if labels[i] >= 0 and _any_near(points, i, end, near):
            for k in range(i, end):
                points[n, 0], points[n, 1] = points[k, 0], points[k, 1]
                kept[n] = n_segments
                n += 1
            n_segments += 1
        i = end
    edge_profile(points[:n], slopes, positions, directions)
    return n, n_segments


@compiled
def _any_near(points: Pixels, first: int, end: int, near: Image) -> bool:
    """Whether one of some pixels is where edges matter; that is everywhere if nothing tells where."""
    matters = near.size == 0
    for i in range(first, end):
        matters = matters or near[points[i, 1], points[i, 0]] != 0
    return matters


@compiled
def _chains_near(points: Pixels, starts: Pixels, n_chains: int, near: Image) -> int:
    """Moves the chains that have a pixel where edges matter to the front; their number."""
    n = n_kept = 0
    for chain in range(n_chains):
        first, end = starts[chain], starts[chain + 1]
        if not _any_near(points, first, end, near):
            continue
        starts[n_kept] = n
        for i in range(first, end):
            points[n, 0], points[n, 1] = points[i, 0], points[i, 1]
            n += 1
        n_kept += 1
    starts[n_kept] = n
    return n_kept
