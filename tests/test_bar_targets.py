"""Targets of a bar: measured to a hundredth of a pixel, followed by name, nothing where nothing is."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tracker.cameras.calibration._bar_images import follow, measure_sphere
from tracker.cameras.calibration._targets import Target, measure_target


def disc(rng: np.random.Generator, centre, radius: float, n: int = 49, noise: float = 1.0) -> np.ndarray:
    """A blurred, noisy picture of a tilted disc, exact to an eighth of a pixel."""
    fine = (np.arange(8 * n) + 0.5) / 8 - 0.5
    x, y = np.meshgrid(fine - centre[0], fine - centre[1])
    angle, flat = rng.uniform(0, np.pi), radius * rng.uniform(0.7, 1.0)
    u, v = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    cover = ((u / radius) ** 2 + (v / flat) ** 2 < 1).astype(float).reshape(n, 8, n, 8).mean(axis=(1, 3))
    blurred = cv2.GaussianBlur(cover, (0, 0), 0.7)
    return np.clip(np.round(60 + 150 * blurred + rng.normal(0, noise, blurred.shape)), 0, 255)


@pytest.mark.parametrize("radius", [3.5, 5.0, 8.0])
def test_discs_are_measured_to_a_hundredth_of_a_pixel(radius):
    rng, errors = np.random.default_rng(0), []
    for _ in range(40):
        centre = 24 + rng.uniform(-0.5, 0.5, 2)
        target = measure_target(disc(rng, centre, radius), (24.0, 24.0), radius)
        assert target is not None
        assert target.axes[0] == pytest.approx(radius, abs=0.3)
        errors.append(np.array(target.centre) - centre)
    assert np.sqrt(np.mean(np.square(errors))) < 0.010


def test_a_bar_before_a_disc_is_no_part_of_its_ellipse():
    rng = np.random.default_rng(1)
    picture = disc(rng, (24.3, 23.8), 7.0)
    picture[22:26, 30:] = 20.0
    target = measure_target(picture, (24.0, 24.0), 7.0)
    assert target is not None
    np.testing.assert_allclose(target.centre, (24.3, 23.8), atol=0.15)


def test_a_ball_lit_from_above_is_not_drawn_to_the_light():
    n, centre, radius = 45, np.array([22.3, 21.6]), 6.0
    x, y = np.meshgrid(np.arange(n) - centre[0], np.arange(n) - centre[1])
    distance = np.hypot(x, y) / radius
    cover = np.clip(0.5 + radius * (1 - distance), 0, 1)
    rng = np.random.default_rng(0)
    behind = 130 + rng.normal(0, 1, (n, n))
    shade = 170 - 60 * y / radius + 20 * np.sqrt(np.clip(1 - distance**2, 0, 1))
    picture = behind * (1 - cover) + shade * cover + rng.normal(0, 1, (n, n))
    target = measure_sphere(picture, behind, (22.0, 20.0), 5.0, 25.0)
    assert target is not None
    np.testing.assert_allclose(target.centre, centre, atol=0.05)


def test_nothing_is_measured_where_nothing_is():
    blank = np.random.default_rng(0).normal(100, 2, (49, 49))
    assert measure_target(blank, (24.0, 24.0), 5.0) is None
    assert measure_sphere(blank, blank, (24.0, 24.0), 5.0, 25.0) is None


def spot(x: float, y: float) -> Target:
    return Target((x, y), (5.0, 5.0), 100.0, 0.1)


def test_targets_that_pass_each_other_keep_their_names():
    times = np.arange(30)
    ways = np.stack(
        [np.column_stack([10.0 * times, 100 + 3.0 * times]), np.column_stack([300 - 10.0 * times, 190 - 3.0 * times])]
    )
    rng = np.random.default_rng(0)
    frames = [[spot(*ways[e, t]) for e in rng.permutation(2)] for t in times]
    found = follow(frames)
    first = 0 if np.allclose(found[0, 0], ways[0, 0]) else 1
    np.testing.assert_allclose(found[:, 0], ways[first])
    np.testing.assert_allclose(found[:, 1], ways[1 - first])


def test_a_view_that_lacks_frames_goes_on():
    frames = [[spot(5.0 * t, 50.0), spot(200.0, 50.0 + t)] if t not in (6, 7, 12) else [] for t in range(20)]
    found = follow(frames)
    assert np.isnan(found[[6, 7, 12]]).all()
    seen = [t for t in range(20) if t not in (6, 7, 12)]
    np.testing.assert_allclose(sorted(found[seen, :, 0].max(axis=1)), [200.0] * len(seen))
