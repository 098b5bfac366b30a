"""Calls of the kernels with arguments without data, of the types that the package uses: what is compiled ahead."""

from __future__ import annotations

from typing import Any

import numpy as np

F8, F4, I8, B1 = np.float64, np.float32, np.int64, np.bool_
I4, I2, U1 = np.int32, np.int16, np.uint8

Call = tuple[Any, tuple[Any, ...]]
"""A kernel and its arguments."""


def own(dtype: Any, *shape: int) -> Any:
    """An array that a kernel may write to."""
    return np.zeros(shape, dtype)


def frozen(dtype: Any, *shape: int) -> Any:
    """A read-only array, as those of values are."""
    array = np.zeros(shape, dtype)
    array.setflags(write=False)
    return array
