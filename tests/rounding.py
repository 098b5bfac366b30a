"""How far rounding leads two ways to one number apart.

Compiled code, BLAS and OpenCV take their instructions by the processor and by how much is asked at once: they add in
another order, or round a product before they add it, or do not. So the very same call, repeated on one machine, gives
the same bits, and no other call does: another number of poses, another thread or buffer, another person beside.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

DOUBLE = 1e-9
"""Of the largest number: a step rounds by 2^-53 = 1.1e-16, ten thousand steps add up to 1.1e-12 at most, and what
matrices and differences of lengths lose beside is a factor of a thousand at most."""

SINGLE = 1e-5
"""The same for numbers that float32 goes into, contours and pictures: 2^-24 = 6e-8 a step, some hundred of them."""


def assert_alike(found: ArrayLike, wanted: ArrayLike, rounding: float | None = None) -> None:
    """Arrays of one shape, the same but for rounding; whole numbers and truth values are the same.

    Args:
        found: of one call.
        wanted: of another one.
        rounding: as a share of the largest finite number in `wanted`; None for `SINGLE` where either array is of single
            precision, else `DOUBLE`.
    """
    one, other = np.asarray(found), np.asarray(wanted)
    assert one.shape == other.shape
    if other.dtype.kind != "f":
        np.testing.assert_array_equal(one, other)
        return
    if rounding is None:
        rounding = SINGLE if np.float32 in (one.dtype, other.dtype) else DOUBLE
    largest = float(np.abs(other, where=np.isfinite(other), out=np.zeros_like(other)).max(initial=0.0))
    np.testing.assert_allclose(one, other, rtol=0, atol=rounding * largest)
