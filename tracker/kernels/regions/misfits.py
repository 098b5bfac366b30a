"""Misfits of contours: how much of the lines across them lies on the wrong side."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Integers
from tracker.kernels.regions.lines import Lines


def score_lines(
    lines: Lines,
    positions: Array32,
    points: Array32,
    parts: Integers,
    counts: Integers,
    beside: Integers,
    cameras: Array,
    misfits: Array,
) -> None:
    """How much beside the contours of many poses lies on the wrong side of them.

    Args:
        lines: what they are compared with.
        positions, points, parts, counts: of `Contours`, for B poses.
        beside: (B, V, M, 2) parts seen at the `SPOTS`.
        cameras: (V, 29) from `Rig.packed`.
        misfits: (B, V, P, 3) output: contour compared, px; times how much of the line lies on the wrong side, px;
            contour whose lines show the part inside and not outside, px.
    """
    native.score_lines(lines, positions, points, parts, counts, beside, cameras, misfits)
