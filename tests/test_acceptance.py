"""Acceptance: distances to expected contours against their twin, and segments that stand or fall as a whole."""

from __future__ import annotations

import numpy as np
import pytest
from rounding import assert_alike

from tracker.foundation.arrays import Array32
from tracker.images.analysis import accepted_segments
from tracker.images.operations.edges import EdgeSegments
from tracker.kernels.edges import expected_distances, marked


def straight(length: int, start: tuple[float, float], step: tuple[float, float]) -> tuple[Array32, Array32]:
    """Points along a line, one a step, and the gradient across it."""
    points = np.array(start) + np.arange(length)[:, None] * np.array(step)
    across = np.array([-step[1], step[0]]) / np.hypot(*step)
    return points.astype(np.float32), np.tile(across, (length, 1)).astype(np.float32)


def segments_of(*pieces: tuple[Array32, Array32]) -> EdgeSegments:
    labels = np.repeat(np.arange(len(pieces)), [len(points) for points, _ in pieces])
    return EdgeSegments(
        np.concatenate([points for points, _ in pieces]),
        np.concatenate([directions for _, directions in pieces]),
        labels,
        len(pieces),
    )


LINE = np.concatenate(straight(100, (50, 100), (2, 0)), axis=1)
"""Expected contour samples along a horizontal line."""


def test_segments_are_accepted_or_rejected_as_units() -> None:
    beside = straight(80, (60, 105), (1, 0))
    leaving = straight(80, (60, 100), (0.6, 0.8))  # begins on the contour and leads 64 px away
    crossing = straight(20, (120, 90), (0, 1))  # mean distance 5 px, but across
    found = segments_of(beside, leaving, crossing)
    everything = np.ones(len(found.points), dtype=np.bool_)
    accepted = accepted_segments(found, LINE, 14.0, 20.0, everything)
    assert [accepted[found.segments == s].mean() for s in range(3)] == [1, 0, 0]
    undirected = accepted_segments(found, LINE, 14.0, 0.0, everything)
    assert [undirected[found.segments == s].mean() for s in range(3)] == [1, 0, 1]
    assert accepted_segments(found, None, 14.0, 20.0, everything).all()
    assert not accepted_segments(found, LINE[:0], 14.0, 20.0, everything).any()


def test_the_mean_directed_distance_of_a_segment_is_compared_with_the_limit() -> None:
    found = segments_of(straight(60, (60, 109), (1, 0)))
    everything = np.ones(60, dtype=np.bool_)
    exact = expected_distances(found.points, found.directions, LINE, 20.0, 56.0).mean()
    assert 9.0 <= exact < 9.1
    assert accepted_segments(found, LINE, float(exact) + 0.01, 20.0, everything).all()
    assert not accepted_segments(found, LINE, float(exact) - 0.01, 20.0, everything).any()


def test_segments_the_background_explains_are_rejected_and_others_lose_the_points_it_explains() -> None:
    found = segments_of(*(straight(40, (60, 98 + 2 * k), (1, 0)) for k in range(2)))
    trusted = np.ones(80, dtype=np.bool_)
    trusted[:10] = False  # a quarter of the first segment
    trusted[40:65] = False  # more than half of the second
    accepted = accepted_segments(found, LINE, 14.0, 20.0, trusted)
    np.testing.assert_array_equal(accepted, trusted & (found.segments == 0))
    np.testing.assert_array_equal(accepted_segments(found, None, 14.0, 20.0, trusted), accepted)


def test_segments_along_the_outline_are_accepted_wherever_they_are() -> None:
    found = segments_of(straight(40, (60, 250), (1, 0)), straight(40, (60, 270), (1, 0)))
    trusted, outline = np.ones((2, 80), dtype=np.bool_)
    outline[30:] = False
    accepted = accepted_segments(found, LINE, 14.0, 20.0, trusted, outline)
    np.testing.assert_array_equal(accepted, found.segments == 0)
    assert not accepted_segments(found, LINE, 14.0, 20.0, ~trusted, outline).any()


def test_nothing_found_is_nothing_accepted() -> None:
    nothing = EdgeSegments(LINE[:0, :2], LINE[:0, 2:], np.zeros(0, dtype=np.int64), 0)
    assert accepted_segments(nothing, LINE, 14.0, 20.0, np.zeros(0, dtype=np.bool_)).shape == (0,)


def oriented(rng: np.random.Generator, n: int) -> tuple[Array32, Array32]:
    angles = rng.uniform(0, 2 * np.pi, n)
    return rng.uniform(0, 200, (n, 2)).astype("f4"), np.stack([np.cos(angles), np.sin(angles)], axis=1).astype("f4")


@pytest.mark.parametrize("bend_px", [0.0, 20.0])
@pytest.mark.parametrize("n_samples", [0, 1, 60])
@pytest.mark.parametrize("n_edges", [0, 1, 32, 300])
@pytest.mark.parametrize("most_px", [15.0, 1000.0])
def test_expected_distances_equal_their_numpy_twin(
    bend_px: float, n_samples: int, n_edges: int, most_px: float
) -> None:
    rng = np.random.default_rng(9)
    edges, directions = oriented(rng, n_edges)
    pixels, normals = oriented(rng, n_samples)
    # Chains of neighbours as well as edges anywhere.
    edges[: n_edges // 2] = edges[:1] + rng.uniform(-20, 20, (n_edges // 2, 2))
    found = expected_distances(edges, directions, np.concatenate([pixels, normals], axis=1), bend_px, most_px)
    gaps = np.linalg.norm(edges[:, None].astype(float) - pixels, axis=2)
    sines = directions[:, None, 0].astype(float) * normals[:, 1] - directions[:, None, 1].astype(float) * normals[:, 0]
    twin = np.sqrt(gaps**2 + (bend_px * sines) ** 2).min(axis=1, initial=most_px)
    np.testing.assert_allclose(found, twin, rtol=1e-4, atol=1e-3)


def test_expected_distances_count_no_direction_sign_and_are_the_largest_without_samples() -> None:
    rng = np.random.default_rng(9)
    edges, directions = oriented(rng, 50)
    samples = np.concatenate(oriented(rng, 20), axis=1)
    same = expected_distances(edges, directions, samples, 20.0, 500.0)
    assert_alike(expected_distances(edges, -directions, samples, 20.0, 500.0), same)
    np.testing.assert_array_equal(expected_distances(edges, directions, samples[:0], 20.0, 500.0), np.float32(500))


def test_points_are_marked_where_the_nearest_pixel_of_the_picture_is_set() -> None:
    rng = np.random.default_rng(2)
    picture = rng.integers(0, 2, (20, 30), dtype=np.uint8)
    points = rng.uniform(-5, 45, (500, 2)).astype(np.float32)
    marks = np.zeros(500, dtype=np.bool_)
    marked(points, picture, (7, 3), marks)
    whole = np.zeros((60, 60), dtype=np.uint8)
    whole[13:33, 17:47] = picture
    columns, rows = np.round(points).astype(int).T + 10
    np.testing.assert_array_equal(marks, whole[rows, columns] > 0)
