"""Numbers as files of keypoints spell them: that a keypoint was not found is spelt in many ways."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from tracker.foundation.arrays import Array
from tracker.foundation.source_files import is_gap


def number(value: Any) -> float:
    """A number of a file; NaN where there is none, a ValueError or TypeError where something else stands."""
    if value is None:
        return np.nan
    if isinstance(value, str):
        word = value.strip()
        return np.nan if is_gap(word) else float(word)
    try:
        return float(value)
    except OverflowError:
        return np.nan


def numbers(values: Any) -> Array:
    """An array of numbers, of a list or of equally long lists of them; see `number`."""
    try:
        return np.array(values, dtype=np.float64)
    except (ValueError, TypeError, OverflowError):  # words, or too large a number
        return np.array(_numbers(values), dtype=np.float64)


def _numbers(values: Any) -> Any:
    return [_numbers(one) if isinstance(one, list) else number(one) for one in values]


def with_gaps(found: Array) -> Array:
    """Keypoints (..., 3) with NaN throughout where one was not found.

    A number is missing or not finite, the confidence is not above 0, or the point is (0, 0) or (-1, -1), which stand
    for none in many programs and which nobody's joint is at to the last digit.
    """
    x, y = found[..., 0], found[..., 1]
    lost = ~np.isfinite(found).all(axis=-1) | (found[..., 2] <= 0) | ((x == y) & ((x == 0) | (x == -1)))
    return np.where(lost[..., None], np.nan, found)


def last_number(name: str) -> int | None:
    """The last whole number in a name of a file or an image, which is that of the frame; None if there is none."""
    digits = _DIGITS.findall(name)
    return int(digits[-1]) if digits and len(digits[-1]) <= _MOST_DIGITS else None


_DIGITS = re.compile(r"\d+")

_MOST_DIGITS = 18
"""Longer ones are no frame's number; Python converts none of some thousand digits."""
