"""Kernels of images: what they cannot take is refused by name, before anything is written."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import tracker._native as native

SIX = (0.45, 0.8, 0.97, 8.0, 0.7, 8.0)
RULE = (4, 0.3, 8)


def image(*shape: int, dtype: Any = np.uint8) -> Any:
    return np.zeros(shape, dtype)


def edges(*places: tuple[int, int]) -> Any:
    picture = image(6, 8)
    for y, x in places:
        picture[y, x] = 1
    return picture


def traced(n: int) -> tuple[Any, ...]:
    return image(n, 2, dtype=np.float32), image(n, 2, dtype=np.float32), image(n, dtype=np.int64)


SLOPES = image(4, 6, dtype=np.int16), image(4, 6, dtype=np.int16)
PIXELS, STARTS = image(3, 2, dtype=np.int32), np.array([0, 3, 3, 3], np.int32)
APART = np.array([[0, 0], [1, 1], [3, 1]], np.int32)
RATIOS, GAINS, MASK = image(3, 4, 3, dtype=np.float64), image(2, 2, 3, dtype=np.float32), image(5, 4, dtype=np.bool_)
LOOKS = (7, 14, 28), False, image(4, 4, 3)

REFUSED = {
    "size: .*at least 1": ("block_ratios", image(6, 8, 3), image(6, 8, 3), 0, 1, RATIOS),
    "step: .*at least 1": ("block_ratios", image(6, 8, 3), image(6, 8, 3), 2, 0, RATIOS),
    "ratios: .*3, 4, 3": ("block_ratios", image(6, 8, 3), image(6, 8, 3), 2, 1, RATIOS[:2]),
    "ratios: .*at least one block": ("smooth_surface", RATIOS[:0], 0.03, 8, 1, RATIOS[:0].copy()),
    "stride: .*at least 1": ("smooth_surface", RATIOS, 0.03, 8, 0, RATIOS.copy()),
    "gains: .*at least one block": ("relight", image(6, 8, 3), GAINS[:0], 24.0, (0, 0, 1), image(6, 8, 3)),
    "size: .*positive": ("relight", image(6, 8, 3), GAINS, np.nan, (0, 0, 1), image(6, 8, 3)),
    "origin: .*inside": ("mark_changes", image(6, 8, 3), image(10, 10, 3), (5, 0), 14.0, image(4, 6)),
    "image: .*6, 8, 3": ("mark_changes", image(6, 6, 3), image(10, 10, 3), (0, 0), 14.0, image(4, 6)),
    "level: .*at least 0": ("mark_changes", image(6, 8, 3), image(10, 10, 3), (0, 0), np.nan, image(4, 6)),
    "labels: .*below n_labels": ("large_regions", np.full((5, 4), 2, np.int32), 2, 0.1, MASK),
    "n_labels: .*at least 1": ("large_regions", image(5, 4, dtype=np.int32), 0, 0.1, MASK),
    "now: .*16, 18, 3": ("without_shadows", image(16, 17, 3), image(16, 18, 3), (0, 0), image(4, 6), SIX, image(4, 6)),
    "origin: .*lies inside": (
        "without_shadows",
        image(16, 18, 3),
        image(16, 18, 3),
        (0, 1),
        image(4, 6),
        SIX,
        image(4, 6),
    ),
    "pile: .*1 to 255": ("dominant_modes", image(256, 2, 2, 3), 12, image(2, 2, 3), image(2, 2), image(2, 2)),
    "reach: .*0 to 255": ("dominant_modes", image(5, 2, 2, 3), -1, image(2, 2, 3), image(2, 2), image(2, 2)),
    "image: .*at least 2": ("strongest_slopes", image(1, 6, 3), SLOPES[0][:1].copy(), SLOPES[1][:1].copy()),
    "edges: .*empty border": ("link_edges", edges((0, 3)), PIXELS, STARTS),
    "edges: .*room": ("link_edges", edges((1, 1), (1, 2), (2, 2), (4, 6)), PIXELS, STARTS),
    "starts: .*neighbouring": ("split_segments", APART, STARTS, 1, RULE, image(3, dtype=np.int32)),
    "starts: .*begin": ("split_segments", PIXELS, STARTS + np.int32(1), 1, RULE, image(3, dtype=np.int32)),
    "rule: .*tangent": ("split_segments", PIXELS, STARTS, 1, (-1, 0.3, 8), image(3, dtype=np.int32)),
    "rule: .*at least 1 point": ("split_segments", PIXELS, STARTS, 1, (4, 0.3, 0), image(3, dtype=np.int32)),
    "points: .*inside": ("edge_profile", np.array([[6, 0]], np.int32), *SLOPES, *traced(1)[:2]),
    "edges: .*empty": ("trace_segments", edges((3, 7)), *SLOPES, RULE, image(0, 0), *traced(2)),
    "near: .*size": ("trace_segments", edges((3, 3)), *SLOPES, RULE, image(4, 5), *traced(2)),
    "segments: .*2,": ("trace_segments", edges((3, 3)), *SLOPES, RULE, image(0, 0), *traced(2)[:2], traced(3)[2]),
    "reach: .*at least 0 px": ("chamfer_distances", PIXELS, np.nan, image(5, 4, dtype=np.float32)),
    "pixels: .*inside": ("chamfer_distances", PIXELS - np.int32(1), 40.0, image(5, 4, dtype=np.float32)),
    "corner: .*inside": ("mark_appearance", image(4, 4, 3), (1, 0), (0, 0, 0), image(100), *LOOKS),
    "weights .*0 to 99, found 255": ("mark_appearance", image(4, 4, 3), (0, 0), (1, 0, 0), image(100), *LOOKS),
    "chroma: .*at most": ("mark_appearance", image(4, 4, 3), (0, 0), (0, 0, 0), image(32769), *LOOKS),
    "slopes: .*0 to 255, found 256": (
        "mark_appearance",
        image(4, 4, 3),
        (0, 0),
        (0, 0, 0),
        image(100),
        (7, 14, 256),
        *LOOKS[1:],
    ),
    "spacing: .*at least 1": ("count_coloured", image(4, 4, 3), 0, 8),
}


@pytest.mark.parametrize("told", REFUSED)
def test_what_a_kernel_cannot_take_is_refused_by_name(told: str) -> None:
    name, *arguments = REFUSED[told]
    with pytest.raises(ValueError, match=f"^{told}"):
        getattr(native, str(name))(*arguments)


def test_points_beyond_all_numbers_are_at_no_pixel() -> None:
    points = np.array([[np.nan, 1], [np.inf, 1], [1e30, 1], [1, 1]], np.float32)
    marks = np.ones(4, np.bool_)
    native.marked(points, np.ones((3, 3), np.uint8), (0, 0), marks)
    np.testing.assert_array_equal(marks, [False, False, False, True])
