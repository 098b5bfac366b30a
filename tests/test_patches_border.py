"""Kernels of patches: what they cannot take is refused by name, before anything is written."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import tracker._native as native

IMAGE, HALF = (np.zeros(30 * 20, np.float32), 30, 20), 2
RULE, NOISE, LIMITS = (HALF, 5, 0.01, 3.0, 0.0, False), (1.0, 1.0, np.ones(3, np.float32)), (9.0, 1.0, 0.5, 2.0)
WARP, ROOM = np.array([15.0, 10, 1, 0, 0, 1]), np.zeros(25, np.float32)
KEYS, N = np.zeros((3, 81), np.float32), 12


def many(n: int) -> Any:
    return np.zeros((n, 15))


def whole(*values: int) -> Any:
    return np.array(values, np.int64)


CELLS = many(N), *np.zeros((3, N), np.int64)
HEAP = np.zeros(5), np.zeros(5, np.int64), whole(0)
BENT = np.zeros((4, 2, 2)), np.zeros((4, 2), np.int64), np.zeros((4, 2, 2)), np.ones(4, np.bool_)


def grown(**changes: Any) -> tuple[Any, ...]:
    names = "template search grid found ended seeds tries keys items count usual larger noise limits budget most"
    good = dict(
        zip(names.split(), (IMAGE, IMAGE, (4, 3, 5), *CELLS, *HEAP, RULE, RULE, NOISE, LIMITS, 1, 1), strict=True)
    )
    return tuple({**good, **changes}.values())


REFUSED = {
    "image: .*width times height": ("sample_patch", (IMAGE[0], 20, 20), WARP, HALF, ROOM),
    "warp: .*inside the image": ("sample_patch", IMAGE, WARP * np.nan, HALF, ROOM),
    "half: .*3 to 127": ("sample_patch", IMAGE, WARP, 64, ROOM),
    "values: .*room": ("sample_patch", IMAGE, WARP, HALF, ROOM[1:]),
    "dy_of: .*room": ("sample_gradient", IMAGE, WARP, HALF, ROOM, ROOM, ROOM[1:]),
    "warp: .*whole pixel": ("sample_whole_pixels", IMAGE, WARP + 0.5, HALF, ROOM, ROOM, ROOM),
    "found: .*2, 15": ("match_patches", IMAGE, IMAGE, np.zeros((2, 2)), many(3), whole(0, 0), RULE, NOISE),
    "search: .*width times": (
        "match_patches",
        IMAGE,
        (IMAGE[0], 0, 20),
        np.zeros((1, 2)),
        many(1),
        whole(0),
        RULE,
        NOISE,
    ),
    "rule: .*3 to 127": ("match_keys", KEYS, whole(0), IMAGE, many(1), whole(0), (0, *RULE[1:]), NOISE),
    "noise: .*taps": ("match_keys", KEYS, whole(0), IMAGE, many(1), whole(0), RULE, (1.0, 1.0, ROOM[:0])),
    "which: .*0 to 2, found 3": ("match_keys", KEYS, whole(3), IMAGE, many(1), whole(0), RULE, NOISE),
    "keys: .*any, 81": ("match_keys", KEYS[:, :80].copy(), whole(0), IMAGE, many(1), whole(0), RULE, NOISE),
    "rows: .*-1 to 3, found 4": ("bending_shifts", BENT[0], BENT[1] + 4, *BENT[2:], HALF, np.zeros((4, 2))),
    "found: .*position": ("stretch", np.ones(5)),
    "grid: .*columns times rows": ("grow", *grown(grid=(5, 3, 5))),
    "count: .*0 to 5, found 6": ("grow", *grown(count=whole(6))),
    "items: .*0 to 47, found 48": ("grow", *grown(items=whole(48, 0, 0, 0, 0), count=whole(1))),
    "tries: .*12,": ("grow", *grown(tries=whole(0))),
    "template: .*width": ("grow", *grown(template=(IMAGE[0], 30, -20))),
}


@pytest.mark.parametrize("told", REFUSED)
def test_what_a_kernel_cannot_take_is_refused_by_name(told: str) -> None:
    name, *arguments = REFUSED[told]
    with pytest.raises(ValueError, match=f"^{told}"):
        getattr(native, str(name))(*arguments)


def test_attempts_that_lead_beyond_the_grid_are_left_out() -> None:
    ended = np.zeros(N, np.int64)
    corner, up = 0, 3
    arguments = grown(ended=ended, items=whole(4 * corner + up, 0, 0, 0, 0), count=whole(1))
    assert native.grow(*arguments) == 0
    np.testing.assert_array_equal(ended, 0)
