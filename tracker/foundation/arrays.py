"""The shape vocabulary: array types, frozen arrays, and the checks at public borders."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
"""Float64 array; its shape is written in the docstring, `(*B, dof)` meaning any leading batch."""

Array32 = NDArray[np.float32]
"""Float32 array, for per-pixel and per-sample data that compiled kernels stream through."""

Image = NDArray[np.uint8]
"""Grey `(h, w)` or BGR colour `(h, w, 3)` image."""

Mask = NDArray[np.bool_]
"""Boolean array."""

Integers = NDArray[np.int64]
"""Indices and counts."""

Region = tuple[int, int, int, int]
"""Part of an image: x, y, width, height, px."""

Numbers16 = NDArray[np.uint16]
"""Small numbers of pixels, such as the colours of a palette."""


def frozen(values: ArrayLike, dtype: Any = np.float64) -> NDArray[Any]:
    """A contiguous read-only copy of `values` with `dtype`."""
    array = np.array(values, dtype=dtype, order="C")
    array.setflags(write=False)
    return array


def shape_fault(values: NDArray[Any], *expected: int | None) -> str | None:
    """What is wrong with an array's shape, or None.

    Args:
        values: the array.
        expected: one length for each axis, None for any length.
    """
    fits = values.ndim == len(expected) and all(
        want is None or have == want for have, want in zip(values.shape, expected, strict=True)
    )
    if fits:
        return None
    words = ", ".join("n" if want is None else str(want) for want in expected)
    return f"shape {values.shape} found, ({words}) expected"
