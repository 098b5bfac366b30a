"""Points that fill a box evenly."""

from __future__ import annotations

import itertools

import numpy as np

from tracker.foundation.arrays import Array


def halton(n: int, n_dimensions: int) -> Array:
    """The first points of Halton's sequence (Halton 1960), (n, n_dimensions) in [0, 1).

    Coordinate d of point i is the radical inverse of i in base p, the d-th prime: the digits of i mirrored at the
    point, ``sum_k a_k p^(-k - 1)`` for ``i = sum_k a_k p^k``. The first point is the origin.

    `scipy.stats.qmc.Halton` gives the same points; scipy.stats takes 0.2 to 0.5 s to import, at the start of every run.
    """
    columns = [_radical_inverses(n, base) for base in _primes(n_dimensions)]
    return np.stack(columns, axis=1) if columns else np.empty((n, 0))


def _radical_inverses(n: int, base: int) -> Array:
    left, inverses, weight = np.arange(n), np.zeros(n), 1.0 / base
    while left.any():
        left, digits = np.divmod(left, base)
        inverses += digits * weight
        weight /= base
    return inverses


def _primes(n: int) -> list[int]:
    found: list[int] = []
    candidates = itertools.count(2)
    while len(found) < n:
        candidate = next(candidates)
        if all(candidate % prime for prime in found):
            found.append(candidate)
    return found
