"""Linking and splitting of edges: plain twins, and the laws of chains and segments."""

from __future__ import annotations

import itertools

import cv2
import numpy as np
import pytest
from rounding import assert_alike

from tracker.foundation.arrays import Array32, Image, Integers
from tracker.images.operations.edges import canny, gradient
from tracker.kernels.edges import Pixels, edge_profile, link_edges, split_segments, trace_segments

RULE = (4, float(np.radians(20.0)), 8)


def edge_maps() -> dict[str, Image]:
    """Noise of several densities, and the edges of a cluttered picture."""
    rng = np.random.default_rng(7)
    maps = {f"{density:.0%}": (rng.random((60, 80)) < density).astype(np.uint8) for density in (0, 0.05, 0.3, 0.7, 1)}
    blobs = cv2.GaussianBlur(rng.integers(0, 256, (90, 120), dtype=np.uint8), (0, 0), 2.0)
    return {**maps, "clutter": canny(gradient(cv2.equalizeHist(blobs), 1.0), 3.0, 7.0)}


EDGE_MAPS = edge_maps()
EVERYWHERE = np.zeros((0, 0), dtype=np.uint8)


def chains_of(edges: Image) -> tuple[Pixels, Pixels]:
    """Points and first points of the chains."""
    n = int(np.count_nonzero(edges))
    points, starts = np.empty((n, 2), dtype=np.int32), np.empty(n + 1, dtype=np.int32)
    n_chains = link_edges(np.pad(edges, 1), points, starts)
    return points, starts[: n_chains + 1]


def plain_chains(edges: Image) -> list[list[tuple[int, int]]]:
    """The twin of the linking: walks to one side, then to the other."""
    free = {(int(x), int(y)) for y, x in np.argwhere(edges)}
    neighbours = ((1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (-1, -1), (1, -1))

    def walk(pixel: tuple[int, int]) -> list[tuple[int, int]]:
        way: list[tuple[int, int]] = []
        while True:
            around = [(pixel[0] + dx, pixel[1] + dy) for dx, dy in neighbours]
            following = next((other for other in around if other in free), None)
            if following is None:
                return way
            free.remove(following)
            way.append(following)
            pixel = following

    chains = []
    for first in sorted(free, key=lambda pixel: pixel[::-1]):
        if first in free:
            free.remove(first)
            forth = walk(first)
            back = walk(first)
            chains.append([*forth[::-1], first, *back] if back else [first, *forth])
    return chains


@pytest.mark.parametrize("name", EDGE_MAPS)
def test_linking_equals_its_plain_twin_and_puts_every_edge_pixel_in_one_chain(name: str) -> None:
    edges = EDGE_MAPS[name]
    points, starts = chains_of(edges)
    chains = [points[a:b] for a, b in itertools.pairwise(starts)]
    assert [[tuple(pixel) for pixel in chain.tolist()] for chain in chains] == plain_chains(edges)
    assert sorted(map(tuple, points[:, ::-1].tolist())) == list(map(tuple, np.argwhere(edges).tolist()))
    for chain in chains:
        assert (np.abs(np.diff(chain, axis=0)).max(axis=1, initial=0) == 1).all()


def plain_segments(points: Pixels, starts: Pixels) -> Integers:
    """The twin of the splitting: recursive Ramer-Douglas-Peucker on the unwrapped tangent angles."""
    reach, tolerance, shortest = RULE
    labels = np.full(len(points), -1, dtype=np.int64)
    n = 0

    def divide(angles: Array32, low: int, high: int, first: int) -> None:
        nonlocal n
        along = np.arange(high - low)
        slope = (np.float64(angles[high - 1]) - angles[low]) / max(high - 1 - low, 1)
        departure = np.abs(angles[low:high] - np.float64(angles[low]) - slope * along)[1:-1]
        if high - low >= 2 * shortest and departure.max() > tolerance:
            where = int(np.clip(low + 1 + departure.argmax(), low + shortest, high - shortest))
            divide(angles, low, where, first)
            divide(angles, where, high, first)
        else:
            labels[first + low : first + high] = n
            n += 1

    for a, b in itertools.pairwise(starts):
        if b - a >= shortest:
            i = np.arange(b - a)
            ends = points[a + np.minimum(i + reach, b - a - 1)] - points[a + np.maximum(i - reach, 0)]
            angles = np.unwrap(np.arctan2(ends[:, 1].astype(float), ends[:, 0].astype(float)))
            divide(angles.astype(np.float32), 0, int(b - a), int(a))
    return labels


@pytest.mark.parametrize("name", EDGE_MAPS)
def test_splitting_equals_its_plain_twin_and_segments_are_long_runs_of_one_chain(name: str) -> None:
    points, starts = chains_of(EDGE_MAPS[name])
    labels = np.empty(len(points), dtype=np.int32)
    n_segments = split_segments(points, starts, len(starts) - 1, RULE, labels)
    np.testing.assert_array_equal(labels, plain_segments(points, starts))
    chain = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    assert ((labels < 0) == (np.diff(starts) < RULE[2])[chain]).all()
    kept = labels[labels >= 0]
    np.testing.assert_array_equal(np.unique(kept), np.arange(n_segments))
    assert (np.diff(kept) >= 0).all()
    assert np.bincount(kept).min(initial=RULE[2]) >= RULE[2]
    assert all(len(np.unique(chain[labels == s])) == 1 for s in range(n_segments))


@pytest.mark.parametrize("name", EDGE_MAPS)
def test_traced_segments_are_the_linked_and_split_chains_that_are_long_enough(name: str) -> None:
    edges = EDGE_MAPS[name]
    points, starts = chains_of(edges)
    labels = plain_segments(points, starts)
    dx, dy = np.random.default_rng(1).integers(-1020, 1021, (2, *edges.shape)).astype(np.int16)
    positions, directions = np.zeros((2, len(points), 2), dtype=np.float32)
    segments = np.zeros(len(points), dtype=np.int64)
    n, n_segments = trace_segments(np.pad(edges, 1), (dx, dy), RULE, EVERYWHERE, (positions, directions, segments))
    kept = labels >= 0
    np.testing.assert_array_equal(segments[:n], labels[kept])
    assert n_segments == labels.max(initial=-1) + 1
    profile = np.zeros((2, n, 2), dtype=np.float32)
    edge_profile(points[kept], (dx, dy), *profile)
    assert_alike(positions[:n], profile[0])
    assert_alike(directions[:n], profile[1])


@pytest.mark.parametrize("name", EDGE_MAPS)
def test_segments_that_are_left_out_early_are_those_without_a_pixel_that_matters(name: str) -> None:
    edges, rng = EDGE_MAPS[name], np.random.default_rng(3)
    dx, dy = rng.integers(-1020, 1021, (2, *edges.shape)).astype(np.int16)
    near = np.zeros(edges.shape, dtype=np.uint8)
    near[10:25, 30:50] = 255 * (rng.random((15, 20)) < 0.2)
    points, starts = chains_of(edges)
    labels = plain_segments(points, starts)
    matter = np.isin(labels, labels[near[points[:, 1], points[:, 0]] > 0]) & (labels >= 0)
    positions, directions = np.zeros((2, len(points), 2), dtype=np.float32)
    segments = np.zeros(len(points), dtype=np.int64)
    n, n_segments = trace_segments(np.pad(edges, 1), (dx, dy), RULE, near, (positions, directions, segments))
    assert n == matter.sum()
    assert n_segments == len(np.unique(labels[matter]))
    np.testing.assert_array_equal(segments[:n], np.unique(labels[matter], return_inverse=True)[1])
    assert name in ("0%", "5%") or 0 < n < (labels >= 0).sum()
    profile = np.zeros((2, n, 2), dtype=np.float32)
    edge_profile(points[matter], (dx, dy), *profile)
    assert_alike(positions[:n], profile[0])
    assert_alike(directions[:n], profile[1])


def test_the_profile_is_the_vertex_of_the_parabola_through_three_slopes() -> None:
    rng = np.random.default_rng(5)
    dx, dy = rng.integers(-1020, 1021, (2, 30, 40)).astype(np.int16)
    dx[10:20], dy[10:20] = 0, 0
    points = np.stack(np.meshgrid(np.arange(40), np.arange(30)), axis=-1).reshape(-1, 2).astype(np.int32)
    edges, directions = np.empty((2, len(points), 2), dtype=np.float32)
    edge_profile(points, (dx, dy), edges, directions)
    slopes = np.stack([dx, dy], axis=-1) / 8
    for (x, y), edge, direction in zip(points, edges, directions, strict=True):
        here = np.linalg.norm(slopes[y, x])
        unit = slopes[y, x] / (here + 1e-9)
        shift = 0.0
        if 0 < x < 39 and 0 < y < 29:
            step = np.array([1, 0] if abs(unit[0]) >= abs(unit[1]) else [0, 1])
            before, after = (slopes[y + s * step[1], x + s * step[0]] @ unit for s in (-1, 1))
            curvature = before - 2 * here + after
            if curvature < -1e-6:
                shift = float(np.clip(0.5 * (before - after) / curvature * (step @ unit), -0.71, 0.71))
        np.testing.assert_allclose(edge, (x, y) + shift * unit, atol=1e-4)
        np.testing.assert_allclose(direction, unit, atol=1e-6)
