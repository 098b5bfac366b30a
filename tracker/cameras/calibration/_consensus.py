"""Bars with gross errors: the rays that agree, and ends that were taken for each other."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from tracker.cameras.calibration._bundle import Noise, Observations, State, residuals
from tracker.cameras.calibration._objects import Bars
from tracker.cameras.calibration._states import camera_of
from tracker.foundation.arrays import Array, Mask
from tracker.kernels.rows import BundleCameraRow

# All pairs of eight cameras; beyond, more pairs hardly change the medians and cost time.
_MOST_PAIRS = 28


def with_consensus(state: State, observations: Observations, sigma_px: float) -> State:
    """Moves each bar end to the place that most of its images agree with.

    Least squares of an end with one gross error among three images may be caught by it; so every pair of rays makes a
    proposal, and the one with the least robust sum of squares over all images is taken.

    Args:
        state: cameras near the truth, and bars.
        observations: images of the ends.
        sigma_px: noise of an image coordinate.
    """
    points = state.objects.points
    directions = _directions(state, observations, len(points))
    centres = state.cameras[:, BundleCameraRow.CENTRE]
    best, least = points, _disagreement(state, observations, sigma_px, points)
    for i, j in itertools.islice(itertools.combinations(range(len(centres)), 2), _MOST_PAIRS):
        proposed = _between_rays(centres[i], directions[i], centres[j], directions[j])
        proposed = np.where(np.isfinite(proposed), proposed, points)
        found = _disagreement(state, observations, sigma_px, proposed)
        # what is only as good as before stays: the bar's length has had its say there
        better = found < least - 1.0
        best, least = np.where(better[:, None], proposed, best), np.where(better, found, least)
    moved = Bars(best.reshape(-1, 2, 3), *_bar(state))
    return State(state.cameras, moved)


def _bar(state: State) -> tuple[float, float]:
    assert isinstance(state.objects, Bars)
    return state.objects.length_m, state.objects.sigma_m


def _directions(state: State, observations: Observations, n_points: int) -> Array:
    """(V, P, 3) unit rays of the images, NaN where there is none."""
    directions = np.full((len(state.cameras), n_points, 3), np.nan)
    for v, row in enumerate(state.cameras):
        mine = observations.views == v
        camera = camera_of(row, "", (10**6, 10**6))
        directions[v, observations.points[mine]] = camera.rays(observations.pixels[mine])
    return directions


def _between_rays(start: Array, along: Array, other_start: Array, other_along: Array) -> Array:
    """(P, 3) middle of the shortest line between rays (P, 3); NaN for parallel ones and behind the cameras."""
    base = other_start - start
    cosine = np.einsum("pi,pi->p", along, other_along)
    a, b = along @ base, other_along @ base
    with np.errstate(divide="ignore", invalid="ignore"):
        sine = 1 - cosine**2
        depth, other_depth = (a - cosine * b) / sine, (cosine * a - b) / sine
    good = (depth > 0.01) & (other_depth > 0.01)
    middle = (start + depth[:, None] * along + other_start + other_depth[:, None] * other_along) / 2
    result: Array = np.where(good[:, None], middle, np.nan)
    return result


def _disagreement(state: State, observations: Observations, sigma_px: float, points: Array) -> Array:
    """(P,) robust sum of squares of each point's images, in standard deviations."""
    tried = State(state.cameras, Bars(points.reshape(-1, 2, 3), *_bar(state)))
    squares = np.minimum(Noise(sigma_px).squares(residuals(tried, observations)), 50.0)
    return np.asarray(np.bincount(observations.points, squares, minlength=len(points)), dtype=np.float64)


def exchange_swapped_ends(state: State, observations: Observations, sigma_px: float) -> tuple[Observations, Mask]:
    """Exchanges the two ends of a bar in a view where that makes them fit better.

    Args:
        state: cameras and bars (points 2g and 2g + 1 are the ends of bar g).
        observations: sorted by bar, end and view.
        sigma_px: noise; differences below it do not count.

    Returns:
        The observations, and (N,) which of them were exchanged.
    """
    n_views = len(state.cameras)
    keys = (observations.points // 2) * n_views + observations.views
    first_end = observations.points % 2 == 0
    position = np.full((keys.max() + 1, 2), -1)
    position[keys, 1 - first_end] = np.arange(len(keys))
    both = position[(position >= 0).all(axis=1)]
    errors = residuals(state, observations)
    a, b = both.T
    across = observations.pixels[a] - observations.pixels[b]
    # the other's pixel minus the own projection
    swapped_a, swapped_b = errors[a] - across, errors[b] + across
    robust = Noise(sigma_px, 5 * sigma_px)
    plain = robust.squares(errors[a]) + robust.squares(errors[b])
    turned = robust.squares(swapped_a) + robust.squares(swapped_b)
    a, b = both[turned < plain - 1].T
    pixels, velocities = observations.pixels.copy(), observations.velocities.copy()
    for values in (pixels, velocities):
        values[a], values[b] = values[b].copy(), values[a].copy()
    exchanged = np.zeros(len(observations), dtype=np.bool_)
    exchanged[a] = exchanged[b] = True
    return replace(observations, pixels=pixels, velocities=velocities), exchanged
