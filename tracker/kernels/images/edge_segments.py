"""Edge segments that matter, from linked pixels (Gavrila & Davis 1996, section 4.2)."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array32, Image, Integers
from tracker.kernels.images.slopes import Slopes


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
    positions, directions, segments = found
    return native.trace_segments(edges, *slopes, rule, near, positions, directions, segments)
