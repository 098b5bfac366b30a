"""Covariances in few bytes, so that they stay covariances: variances, and partial correlations as small numbers.

Rounded correlations can make a matrix that is none of any variables; rounded partial correlations cannot: each may be
anything between -1 and 1 whatever the others are (Joe 2006; Lewandowski, Kurowicka & Joe 2009, section 2). Those of a
parameter and each one before it, given all that come before that one, are kept as Fisher's z, the inverse hyperbolic
tangent, in steps of 1/64.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from tracker.foundation.arrays import Array, Integers, Numbers16
from tracker.foundation.errors import SequenceError

_STEP = 1 / 64
"""Of z. Measured with 22 and 36 parameters: standard deviations of 2000 random combinations stay right to 2 %, those of
the worst combination there is to 16 %; steps of 1/128 halve that, and 36 parameters then take 2.1 KB a frame."""

_MOST_STEPS = 320
"""A partial correlation of 0.9999."""

_ROUNDS = 4
"""After which correlations that change with each rounding are given up: one is enough for bodies; of 2000 matrices that
were made to be nearly singular, 23 were given up."""


@dataclass(frozen=True)
class KeptCovariance:
    """A covariance matrix as it is kept; `covariance_of` it is kept as the same numbers again."""

    variances: Array
    """(dof,) as bfloat16 holds them, to 0.2 %; NaN where not known."""

    steps: Integers
    """(dof (dof - 1) / 2,) partial correlations of the lower triangle, row by row; none where not known."""

    def packed(self) -> tuple[bytes, bytes]:
        """Variances, 2 bytes each; the steps compressed: the low bytes of all, then all high bytes, mostly 0 or -1."""
        pairs = self.steps.astype("<i2").view(np.uint8).reshape(-1, 2)
        return _halves(self.variances).tobytes(), zlib.compress(np.ascontiguousarray(pairs.T).tobytes(), 9)


def _halves(variances: Array) -> Numbers16:
    """The nearest bfloat16 numbers: the upper halves of float32."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        bits = np.asarray(variances, dtype="<f4").view("<u4")
    return np.asarray(np.where(np.isfinite(variances), bits + 0x8000, bits) >> 16, dtype=np.uint16)


def _whole(halves: Numbers16) -> Array:
    return (halves.astype("<u4") << 16).view("<f4").astype(np.float64)


def unpacked(variances: bytes, packed: bytes) -> KeptCovariance:
    """The numbers of `KeptCovariance.packed`.

    Raises:
        SequenceError: they are no such numbers, or not as many as the variances ask for.
    """
    known = _whole(np.frombuffer(variances, dtype="<u2"))
    n = len(known) * (len(known) - 1) // 2
    inflating = zlib.decompressobj()
    try:
        content = inflating.decompress(packed, 2 * n + 1)
    except zlib.error as error:
        raise SequenceError(str(error)) from error
    if len(content) not in (0, 2 * n) or not inflating.eof:
        raise SequenceError(f"{len(content)} bytes of correlations, expected {2 * n}")
    pairs = np.frombuffer(content, dtype=np.uint8).reshape(2, -1)
    steps = np.ascontiguousarray(pairs.T).view("<i2").ravel().astype(np.int64)
    if (np.abs(steps) > _MOST_STEPS).any():
        raise SequenceError("a correlation beyond 1")
    return KeptCovariance(known, steps)


def kept(covariance: Array) -> KeptCovariance:
    """What is kept of a covariance matrix (dof, dof); NaN in it is something not known."""
    found = _rounded(covariance)
    for _ in range(_ROUNDS):
        again = _rounded(covariance_of(found))
        if np.array_equal(again.steps, found.steps):
            return found
        found = again
    return KeptCovariance(found.variances, 0 * found.steps)


def covariance_of(found: KeptCovariance) -> Array:
    """The covariance matrix (dof, dof) that was kept."""
    n = len(found.variances)
    if not len(found.steps):
        covariance: Array = np.full((n, n), np.nan)
    else:
        partial = np.zeros((n, n))
        partial[np.tril_indices(n, -1)] = np.tanh(_STEP * found.steps)
        # of a row of the Cholesky factor, what is left of its length 1 before each column
        left = np.sqrt(np.cumprod(np.column_stack([np.ones(n), 1 - partial[:, :-1] ** 2]), axis=1))
        factor = np.tril(partial * left, -1) + np.diag(np.diag(left))
        sigmas = np.sqrt(found.variances)
        covariance = sigmas[:, None] * (factor @ factor.T) * sigmas
    np.fill_diagonal(covariance, found.variances)
    return covariance


def _rounded(covariance: Array) -> KeptCovariance:
    """The nearest numbers; parameters that are certain or not known are correlated with none."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        variances = _whole(_halves(np.diag(covariance)))
        scale = np.sqrt(np.where(np.diag(covariance) > 0, np.diag(covariance), 0.0))
        correlations = covariance / np.where(scale > 0, scale, np.inf)[:, None] / np.where(scale > 0, scale, np.inf)
    np.fill_diagonal(correlations, 1.0)
    if not (np.isfinite(correlations).all() and np.isfinite(variances).all() and (variances >= 0).all()):
        return KeptCovariance(variances, np.zeros(0, dtype=np.int64))
    factor = _factored(correlations)
    left = np.maximum(1 - np.cumsum(factor**2, axis=1) + factor**2, 1e-12)
    rows = np.tril_indices(len(factor), -1)
    most = np.tanh(_STEP * _MOST_STEPS)
    partial = np.clip(factor[rows] / np.sqrt(left[rows]), -most, most)
    return KeptCovariance(variances, np.round(np.arctanh(partial) / _STEP).astype(np.int64))


def _factored(correlations: Array) -> Array:
    """Cholesky factor of a correlation matrix; of one that is none, by rounding errors, that of one beside it."""
    shrunk = 0.0
    while shrunk < 1:
        try:
            beside = (1 - shrunk) * correlations + shrunk * np.eye(len(correlations))
            return np.asarray(np.linalg.cholesky(beside), dtype=np.float64)
        except np.linalg.LinAlgError:
            shrunk = max(1e-9, 10 * shrunk)
    return np.eye(len(correlations))
