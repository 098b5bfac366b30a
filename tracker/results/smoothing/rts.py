"""The Rauch-Tung-Striebel smoother over the estimated covariances."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pydantic

from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.results.smoothing import Smoothed, Stretch

_ORDER = 3
"""A parameter's state: its value, velocity and acceleration, whose change is white noise."""

_RATIOS = np.logspace(-12, 2, 29)
"""Tested ratios of the acceleration's noise to that of the poses, per frame: from movements of a tenth of a hertz at
200 frames/s to no smoothing at all; half a decade is a twelfth in bandwidth."""

_LEAST_SIGMA = 1e-5
"""Least standard deviation, rad or m: a parameter at its limit is no better known."""

_LEAST_SHARE = 0.1
"""Least share of a sigma that is jitter: a parameter that stands still has none."""

_CHUNK = 200
"""Number of frames whose filtered states are held at a time: 60 MB with 36 parameters."""

_FASTEST = np.array([30.0, 1000.0])
"""Sigmas of the velocity and acceleration before the first frame, rad/s or m/s, and per second."""


@component
class RauchTungStriebel:
    """Kalman filter and smoother with the whole covariance of every pose: other frames complete an uncertain one.

    It has no settings. The strength of the movement and the share of the sigmas that is jitter maximize the likelihood,
    for each parameter (Kalman 1960; Rauch, Tung, Striebel 1965). The rest of a covariance
    stays, because smoothing cannot reduce it: the sigmas of smooth poses are those of their whole error.
    """

    max_gap_s: float = pydantic.Field(default=0.2, ge=0)
    """Longest gap that is filled, seconds without a pose; frames of longer ones stay lost."""

    def check(self, interval_s: float) -> None:
        """Any frame rate will do; see `tracker.results.smoothing.Smoothing.check`."""

    def smooth(self, stretches: Sequence[Stretch]) -> list[Smoothed]:
        """Smooths the stretches with one set of noises; see `tracker.results.smoothing.Smoothing.smooth`."""
        if not stretches:
            return []
        noise = _likeliest(stretches)
        return [_smoothed(stretch, noise) for stretch in stretches]


@dataclass(frozen=True)
class Noise:
    """Model of a person's movement, and of the estimates' jitter."""

    interval_s: float
    """Unit of time in here, so that all states are of one size."""

    movement: Array
    """(dof,) intensity of the white noise that changes accelerations, squared units per interval."""

    shares: Array
    """(dof,) jitter over the sigmas of the estimates."""

    def jitter(self, covariances: Array) -> Array:
        """(*B, dof, dof) covariances of the jitter alone."""
        jitter: Array = self.shares[:, None] * covariances * self.shares
        return jitter

    def rest(self, covariances: Array) -> Array:
        """(*B, dof, dof) the rest of the covariances."""
        rest = np.sqrt(1 - np.minimum(self.shares, 1) ** 2)
        slow: Array = rest[:, None] * covariances * rest
        return slow


def _step(tau: float) -> tuple[Array, Array]:
    """Transition (3, 3) over a time in intervals, and the covariance (3, 3) that noise of intensity 1 adds."""
    power = [tau**n for n in range(6)]
    moved = np.array([[1, tau, power[2] / 2], [0, 1, tau], [0, 0, 1]])
    added = np.array(
        [
            [power[5] / 20, power[4] / 8, power[3] / 6],
            [power[4] / 8, power[3] / 3, power[2] / 2],
            [power[3] / 6, power[2] / 2, tau],
        ]
    )
    return moved, added


def _likeliest(stretches: Sequence[Stretch]) -> Noise:
    """Movement and jitter of the largest likelihood, each parameter by itself.

    For a ratio of the two, the jitter's variance is the mean of the squared normalized innovations (Harvey 1989, 3.4).
    """
    interval_s = float(np.median(np.concatenate([np.diff(stretch.times_s) for stretch in stretches])))
    usual = np.median(np.concatenate([_sigmas(s)[s.known] for s in stretches]), axis=0)
    movement = _RATIOS[:, None] * usual**2
    squares, logarithms, n_values = np.zeros_like(movement), np.zeros_like(movement), 0
    for stretch in stretches:
        for innovation, variance in _innovations(stretch, movement, interval_s):
            squares += innovation**2 / variance
            logarithms += np.log(variance)
            n_values += 1
    variances = np.maximum(squares / n_values, _LEAST_SHARE**2)
    surprise = n_values * np.log(variances) + logarithms + squares / variances
    best, columns = surprise.argmin(axis=0), np.arange(movement.shape[1])
    found = variances[best, columns]
    return Noise(interval_s, movement[best, columns] * found, np.sqrt(found))


def _innovations(stretch: Stretch, movement: Array, interval_s: float) -> Iterator[tuple[Array, Array]]:
    """New information of each pose beyond those before it, and its variance, for all movements (C, dof) at once."""
    sigmas = _sigmas(stretch)
    state = np.zeros((*movement.shape, _ORDER))
    state[..., 0] = stretch.poses[0]
    spread = np.zeros((*movement.shape, _ORDER, _ORDER))
    spread[..., 0, 0] = sigmas[0] ** 2
    spread[..., [1, 2], [1, 2]] = (_FASTEST * interval_s ** np.arange(1, _ORDER)) ** 2
    n_known = 1
    for t in range(1, len(stretch.times_s)):
        moved, added = _step((stretch.times_s[t] - stretch.times_s[t - 1]) / interval_s)
        state, spread = state @ moved.T, moved @ spread @ moved.T + movement[..., None, None] * added
        if not stretch.known[t]:
            continue
        variance = spread[..., 0, 0] + sigmas[t] ** 2
        innovation, gain = stretch.poses[t] - state[..., 0], spread[..., 0] / variance[..., None]
        state = state + gain * innovation[..., None]
        spread = spread - gain[..., None] * spread[..., None, 0, :]
        n_known += 1
        if n_known > _ORDER:  # the first ones only tell where it begins
            yield innovation, variance


def _smoothed(stretch: Stretch, noise: Noise) -> Smoothed:
    """Forwards and backwards through a stretch, all parameters together.

    Covariances of all states would fill the memory (93 kB a frame with 36 parameters): those of the filter are kept
    every `_CHUNK` frames, and computed again from there on the way back.
    """
    n, dof = stretch.poses.shape
    told = _told(stretch)
    begins = list(range(0, max(n - 1, 1), _CHUNK))
    kept = [_first(stretch, noise, told)]
    for begin, end in pairwise(begins):
        kept.append(deque(_onwards(stretch, noise, told, kept[-1], range(begin + 1, end + 1)), maxlen=1)[0])
    states, spreads = np.zeros((n, _ORDER * dof)), np.zeros((n, dof, dof))
    later: tuple[Array, Array] | None = None
    for begin, start in zip(reversed(begins), reversed(kept), strict=True):
        end = min(begin + _CHUNK, n - 1)
        steps = [start, *_onwards(stretch, noise, told, start, range(begin + 1, end + 1))]
        later = later or (steps[-1].state, steps[-1].spread)
        states[end], spreads[end] = later[0], later[1][:dof, :dof]
        for t in range(end - 1, begin - 1, -1):
            later = _back(steps[t - begin], steps[t - begin + 1], *later)
            states[t], spreads[t] = later[0], later[1][:dof, :dof]
    value, velocity, acceleration = states.reshape(n, _ORDER, dof).transpose(1, 0, 2)
    known = np.flatnonzero(stretch.known)
    places = np.searchsorted(known, np.arange(n))
    nearest = known[np.minimum(places, len(known) - 1)]  # the next known one: slow errors hardly change in a gap
    h = noise.interval_s
    return Smoothed(value, velocity / h, acceleration / h**2, spreads + noise.rest(told[nearest]))


@dataclass(frozen=True)
class _Filtered:
    """The state at one time given the frames so far, and its transition from the one before."""

    moved: Array
    predicted: Array
    predicted_spread: Array
    state: Array
    spread: Array


def _first(stretch: Stretch, noise: Noise, told: Array) -> _Filtered:
    """The state in the first frame: all values, then all velocities, then all accelerations."""
    dof, h = stretch.poses.shape[1], noise.interval_s
    state: Array = np.concatenate([stretch.poses[0], np.zeros(2 * dof)])
    spread: Array = np.diag(np.repeat([0.0, *((_FASTEST * [h, h**2]) ** 2)], dof))
    spread[:dof, :dof] = noise.jitter(told[0])
    return _Filtered(np.eye(_ORDER), state, spread, state, spread)


def _onwards(stretch: Stretch, noise: Noise, told: Array, start: _Filtered, frames: range) -> Iterator[_Filtered]:
    """The Kalman filter from the frame before on."""
    dof, state, spread = stretch.poses.shape[1], start.state, start.spread
    for t in frames:
        moved, added = _step((stretch.times_s[t] - stretch.times_s[t - 1]) / noise.interval_s)
        whole = _lifted(moved, dof)
        predicted: Array = whole @ state
        predicted_spread: Array = whole @ spread @ whole.T + np.kron(added, np.diag(noise.movement))
        state, spread = predicted, predicted_spread
        if stretch.known[t]:
            gain = np.linalg.solve(spread[:dof, :dof] + noise.jitter(told[t]), spread[:dof]).T
            state = state + gain @ (stretch.poses[t] - state[:dof])
            spread = _symmetric(spread - gain @ spread[:dof])
        yield _Filtered(moved, predicted, predicted_spread, state, spread)


def _back(now: _Filtered, after: _Filtered, state: Array, spread: Array) -> tuple[Array, Array]:
    """State and covariance given all frames, from those of the frame after."""
    moved = _lifted(after.moved, len(state) // _ORDER)
    back = np.linalg.solve(after.predicted_spread, moved @ now.spread).T
    change = _symmetric(now.spread + back @ (spread - after.predicted_spread) @ back.T)
    return now.state + back @ (state - after.predicted), change


def _lifted(matrix: Array, dof: int) -> Array:
    """A matrix for the three values of one parameter as that for all parameters."""
    return np.asarray(np.kron(matrix, np.eye(dof)), dtype=np.float64)


def _symmetric(matrix: Array) -> Array:
    return (matrix + matrix.T) / 2


def _sigmas(stretch: Stretch) -> Array:
    return np.maximum(stretch.sigmas, _LEAST_SIGMA)


def _told(stretch: Stretch) -> Array:
    """(T, dof, dof) covariances; missing ones are diagonal, with sigmas of 1."""
    given = np.isfinite(stretch.covariances).all(axis=(1, 2), keepdims=True)
    least = _LEAST_SIGMA**2 * np.eye(stretch.poses.shape[1])
    diagonal = stretch.sigmas[:, :, None] ** 2 * np.eye(stretch.poses.shape[1])
    return np.where(given, stretch.covariances + least, diagonal)
