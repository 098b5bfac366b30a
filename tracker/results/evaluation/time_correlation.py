"""Time offset of two recordings of a movement: their flexion angles are correlated, which needs no common frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import correlate, find_peaks

from tracker.foundation.arrays import Array, Mask
from tracker.foundation.errors import SequenceError

_RATE_HZ = 100.0
"""Rate of the common clock; the next fit refines the time, so half a sample is more than enough."""

_MOST_SAMPLES = 400_000
"""Largest number of samples: an hour at that rate; longer recordings are sampled less often."""

_LEAST_TURN_DEG = 2.0
"""Standard deviation from which on an angle counts: twice the noise of markers."""

_LEAST_SHARED = 0.5
"""Share of the shorter recording that both must cover."""

_LEAST_CORRELATION = 0.5
"""Correlation below which the movements may differ."""

_MOST_PROPOSALS = 4
"""Proposals of each angle, and of their mean: a periodic movement has several."""

_APART_S = 0.1
"""Proposals closer together than this are one: the fit reaches that far."""


@dataclass(frozen=True)
class Clocked:
    """Points over time."""

    times_s: Array
    """(T,) seconds, increasing."""

    points: Array
    """(T, J, 3) metres, NaN where missing."""

    def at(self, times_s: Array) -> Array:
        """(T', J, 3) interpolated linearly; NaN outside and in gaps."""
        return _between(self.times_s, self.points, times_s)

    def velocities_at(self, times_s: Array) -> Array:
        """(T', J, 3) metres a second."""
        return _between(self.times_s, np.gradient(self.points, self.times_s, axis=0), times_s)


def _between(known_s: Array, values: Array, times_s: Array) -> Array:
    """Linear interpolation (T', ...) that leaves gaps and missing frames open."""
    k = np.clip(np.searchsorted(known_s, times_s, side="right") - 1, 0, len(known_s) - 2)
    span = known_s[k + 1] - known_s[k]
    weight = ((times_s - known_s[k]) / span).reshape(-1, *(1,) * (values.ndim - 1))
    # a sample itself is known though its neighbour may not be
    between = np.where(weight == 0, values[k], (1 - weight) * values[k] + weight * values[k + 1])
    apart = span > _LEFT_OUT * np.median(np.diff(known_s))
    outside = (times_s < known_s[0]) | (times_s > known_s[-1])
    between[outside | (apart & (weight.reshape(-1) > 0))] = np.nan
    return between


_LEFT_OUT = 2.5
"""Samples are not neighbours beyond this many usual intervals."""


def flexions(points: Array, hinges: list[tuple[int, int, int]]) -> Array:
    """(T, H) angles between the two bones of each hinge, degrees, 0 straight; NaN where a joint is missing.

    Args:
        points: (T, J, 3) metres.
        hinges: columns of the joint before, the hinge, and the joint behind.
    """
    columns = np.array(hinges, dtype=np.int64).reshape(-1, 3)
    upper = points[:, columns[:, 1]] - points[:, columns[:, 0]]
    lower = points[:, columns[:, 2]] - points[:, columns[:, 1]]
    lengths = np.linalg.norm(upper, axis=-1) * np.linalg.norm(lower, axis=-1)
    cosine = (upper * lower).sum(axis=-1) / np.where(lengths > 0, lengths, np.nan)
    degrees: Array = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    return degrees


def offsets_by_angles(ours: Clocked, theirs: Clocked, hinges: list[tuple[int, int, int]]) -> list[tuple[float, float]]:
    """Proposals for the lead of the second clock.

    Args:
        ours: a track.
        theirs: the same joints, by another clock.
        hinges: columns of the joints whose flexion is compared.

    Returns:
        Correlation and offset (theirs = ours + offset, seconds), the best first.

    Raises:
        SequenceError: no hinge is in both, none moves, or nothing correlates.
    """
    if not hinges:
        raise SequenceError("no hinge (an elbow or a knee with both neighbours) is in common: give --offset")
    rate = min(_RATE_HZ, _MOST_SAMPLES / _longest(ours, theirs))
    pairs = list(zip(_sampled(ours, hinges, rate).T, _sampled(theirs, hinges, rate).T, strict=True))
    moving = [pair for pair in pairs if all(_turns(curve) for curve in pair)]
    if not moving:
        raise SequenceError(
            f"no hinge turns by {_LEAST_TURN_DEG:g} degrees in both recordings: angles show no offset, give --offset"
        )
    curves = np.array([_correlations(*pair) for pair in moving])
    lags = np.arange(curves.shape[1]) - (len(pairs[0][0]) - 1)
    origin = float(theirs.times_s[0] - ours.times_s[0])
    found: list[tuple[float, float]] = []
    for curve in (curves.mean(axis=0), *curves):
        found += [(float(curve[k]), origin + float(lags[k]) / rate) for k in _peaks(curve)]
    found.sort(reverse=True)
    if not found or found[0][0] < _LEAST_CORRELATION:
        best = f"{found[0][0]:.2f}" if found else "none"
        raise SequenceError(
            f"the flexion angles do not vary together (best correlation {best}, expected {_LEAST_CORRELATION:g} or "
            "more): check that the files show the same movement, the marker set, and --person; or give --offset"
        )
    return _apart(found)


def _longest(*tracks: Clocked) -> float:
    return max(float(track.times_s[-1] - track.times_s[0]) for track in tracks)


def _sampled(track: Clocked, hinges: list[tuple[int, int, int]], rate: float) -> Array:
    """(N, H) flexions at an even rate from the first sample on."""
    n = int((track.times_s[-1] - track.times_s[0]) * rate) + 1
    return _between(track.times_s, flexions(track.points, hinges), track.times_s[0] + np.arange(n) / rate)


def _turns(curve: Array) -> bool:
    known = curve[np.isfinite(curve)]
    return len(known) > 1 and bool(known.std() > _LEAST_TURN_DEG)


def _correlations(ours: Array, theirs: Array) -> Array:
    """Pearson's coefficient at every lag, over the samples of both; -1 if they share too few.

    Masked normalized correlation (Padfield, CVPR 2010).
    """
    mine, other = _known(ours), _known(theirs)
    a, b = _centred(ours, mine), _centred(theirs, other)
    n = _slid(other, mine)
    shared: Mask = n >= _LEAST_SHARED * min(mine.sum(), other.sum())
    count = np.where(shared, n, 1.0)
    sum_a, sum_b = _slid(other, a), _slid(b, mine)
    covariance = _slid(b, a) - sum_a * sum_b / count
    spread = (_slid(other, a * a) - sum_a**2 / count) * (_slid(b * b, mine) - sum_b**2 / count)
    usable = shared & (spread > (count * _LEAST_TURN_DEG**2) ** 2)
    coefficients: Array = np.where(usable, covariance / np.sqrt(np.where(usable, spread, 1.0)), -1.0)
    return coefficients


def _known(curve: Array) -> Array:
    return np.isfinite(curve).astype(np.float64)


def _centred(curve: Array, known: Array) -> Array:
    return np.where(known > 0, curve - np.nanmean(curve), 0.0)


def _slid(theirs: Array, ours: Array) -> Array:
    slid: Array = correlate(theirs, ours, method="fft")
    return slid


def _peaks(curve: Array) -> list[int]:
    """Indices of the highest local maxima, ends included."""
    found, _ = find_peaks(np.concatenate([[-2.0], curve, [-2.0]]))
    ranked = sorted((found - 1).tolist(), key=lambda k: -float(curve[k]))
    return [k for k in ranked if curve[k] > 0][:_MOST_PROPOSALS]


def _apart(found: list[tuple[float, float]]) -> list[tuple[float, float]]:
    chosen: list[tuple[float, float]] = []
    for correlation, offset in found:
        if all(abs(offset - other) > _APART_S for _, other in chosen):
            chosen.append((correlation, offset))
    return chosen
