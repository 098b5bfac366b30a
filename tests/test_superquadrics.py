"""Tapered superquadrics: points lie on the surface, normals are its gradient, samples cover it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tracker.bodies.segments import TaperedSuperquadric
from tracker.foundation.arrays import Array
from tracker.foundation.errors import ModelError
from tracker.foundation.geometry.superquadrics import inside_outside, signed_distance, spread, surface

SHAPES = {
    "sphere": (0.2, 0.2, 0.2, 1.0, 1.0, 0.0, 0.0),
    "ellipsoid": (0.1, 0.2, 0.4, 1.0, 1.0, 0.0, 0.0),
    "can": (0.05, 0.04, 0.3, 0.3, 1.0, 0.0, 0.0),
    "box": (0.1, 0.2, 0.3, 0.2, 0.2, 0.0, 0.0),
    "limb": (0.06, 0.05, 0.25, 0.5, 1.0, -0.26, -0.2),
    "torso": (0.11, 0.165, 0.33, 0.45, 0.85, 0.2, 0.06),
    "cone": (0.1, 0.1, 0.2, 0.6, 0.9, -0.7, -0.7),
}
each = pytest.mark.parametrize("shape", [np.array(row) for row in SHAPES.values()], ids=SHAPES.keys())


def directions(n_eta: int = 31, n_omega: int = 40) -> tuple[Array, Array]:
    """Latitudes and longitudes off the seams, where gradients may be steep or undefined."""
    eta = np.linspace(-1.5, 1.5, n_eta)[:, None] + 0.013
    return eta, np.linspace(-np.pi, np.pi, n_omega)[None, :] + 0.017


@each
def test_points_lie_on_the_surface(shape: Array) -> None:
    points, normals = surface(shape, *directions())
    assert points.shape == normals.shape == (31, 40, 3)
    np.testing.assert_allclose(inside_outside(shape, points), 1, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1, atol=1e-12)


@each
def test_normals_are_the_gradient_of_the_inside_outside_function(shape: Array) -> None:
    points, normals = surface(shape, *directions())
    # points closer than a difference step to a seam x = 0, y = 0 or to an end have no two-sided difference
    step = 1e-6 * shape[:3].min()
    clear = (np.abs(points) > 1e-3 * shape[:3]).all(axis=-1) & (np.abs(points[..., 2]) < shape[2] - 2 * step)
    points, normals = points[clear], normals[clear]
    assert len(points) > 300
    moves = step * np.eye(3)
    gradient = np.stack(
        [inside_outside(shape, points + d) - inside_outside(shape, points - d) for d in moves], axis=-1
    ) / (2 * step)
    gradient /= np.linalg.norm(gradient, axis=-1, keepdims=True)
    assert np.degrees(np.arccos((gradient * normals).sum(axis=-1).clip(-1, 1))).max() < 0.05


@each
def test_normals_point_outwards(shape: Array) -> None:
    points, normals = surface(shape, *directions())
    step = 1e-3 * shape[:3].min() * normals
    assert (inside_outside(shape, points + step) > 1).all()
    assert (inside_outside(shape, points - step) < 1).all()
    assert inside_outside(shape, np.zeros(3)) == 0


@each
def test_beyond_the_ends_is_outside(shape: Array) -> None:
    beyond = np.array([[0, 0, 1.01], [0, 0, -1.01], [0.3, 0.3, 1.2]]) * shape[:3]
    assert (inside_outside(shape, beyond) > 1).all()


@each
def test_tangent_planes_touch_without_cutting(shape: Array) -> None:
    """With taper up to 0.7 the shape is convex: no surface point lies beyond another one's tangent plane."""
    points, normals = (values.reshape(-1, 3) for values in surface(shape, *directions()))
    beyond = normals @ points.T - (normals * points).sum(axis=1)[:, None]
    assert beyond.max() < 1e-9


@each
def test_the_poles_look_along_the_axis(shape: Array) -> None:
    points, normals = surface(shape, np.array([-np.pi / 2, np.pi / 2]), np.array([0.4, 0.4]))
    np.testing.assert_allclose(points, [(0, 0, -shape[2]), (0, 0, shape[2])], atol=1e-4)
    np.testing.assert_allclose(np.abs(normals[:, 2]), 1, atol=1e-6)


def test_taper_grows_linearly_towards_the_plus_end() -> None:
    shape = np.array([0.1, 0.2, 0.5, 0.1, 1.0, 0.3, -0.4])
    for height in (-0.9, -0.5, 0.0, 0.5, 0.9):
        eta = np.arcsin(np.sign(height) * np.abs(height) ** (1 / 0.1))
        ring = np.cos(eta) ** 0.1
        ends, _ = surface(shape, np.array([eta, eta]), np.array([0, np.pi / 2]))
        np.testing.assert_allclose(ends[:, 2], 0.5 * height, atol=1e-12)
        assert ends[0, 0] == pytest.approx(0.1 * ring * (1 + 0.3 * height))
        assert ends[1, 1] == pytest.approx(0.2 * ring * (1 - 0.4 * height))


@each
def test_spread_samples_cover_the_profile_and_the_ring(shape: Array) -> None:
    """Half the steps follow length and half turning: no step takes much over two shares of either."""
    n_eta, n_omega = 17, 32
    eta, omega = spread(shape, n_eta, n_omega)
    assert eta.shape == (n_eta,)
    assert omega.shape == (n_omega,)
    np.testing.assert_allclose(eta[[0, -1]], [-np.pi / 2, np.pi / 2])
    assert (np.diff(eta) > 0).all()
    assert (np.diff(omega) > 0).all()
    for latitudes, longitudes, n in (
        (eta, np.zeros_like(eta), n_eta - 1),
        (np.zeros(n_omega + 1), np.append(omega, omega[0] + 2 * np.pi), n_omega),
    ):
        points, _ = surface(shape, latitudes, longitudes)
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        assert steps.max() < 2.2 * steps.sum() / n


def test_spread_is_even_on_a_sphere() -> None:
    eta, omega = spread(np.array(SHAPES["sphere"]), 9, 16)
    np.testing.assert_allclose(np.diff(eta), np.pi / 8, atol=1e-3)
    np.testing.assert_allclose(np.diff(omega), np.pi / 8, atol=1e-3)


def test_the_shape_is_its_packed_row() -> None:
    shape = TaperedSuperquadric(np.array([0.1, 0.2, 0.3]), np.array([0.5, 0.9]), np.array([-0.1, 0.2]))
    np.testing.assert_array_equal(shape.packed, [0.1, 0.2, 0.3, 0.5, 0.9, -0.1, 0.2])
    points, normals = shape.surface(*directions())
    theirs = surface(shape.packed, *directions())
    np.testing.assert_array_equal(points, theirs[0])
    np.testing.assert_array_equal(normals, theirs[1])
    np.testing.assert_allclose(shape.inside_outside(points), 1, atol=1e-9)
    assert not shape.packed.flags.writeable


def test_scaling_stretches_length_and_girth() -> None:
    shape = TaperedSuperquadric(np.array([0.1, 0.2, 0.3]), np.array([0.5, 0.9]), np.array([-0.1, 0.2]))
    points, _ = shape.surface(*directions())
    longer, _ = shape.scaled(length=1.2, girth=0.8).surface(*directions())
    np.testing.assert_allclose(longer, points * (0.8, 0.8, 1.2), atol=1e-12)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"size": np.array([0.1, 0.0, 0.3])}, r"half extents \[0\.1, 0\.0, 0\.3\] m, expected positive"),
        ({"size": np.array([0.1, -0.2, 0.3])}, "expected positive"),
        ({"size": np.array([0.1, np.nan, 0.3])}, "expected positive"),
        ({"size": np.ones(2)}, r"size: shape \(2,\) found, \(3\) expected"),
        ({"squareness": np.array([0.05, 1])}, r"squareness \[0\.05, 1\.0\], expected 0\.1 to 1"),
        ({"squareness": np.array([1.5, 1])}, r"expected 0\.1 to 1"),
        ({"taper": np.array([0.0, 1.0])}, r"taper \[0\.0, 1\.0\], expected -0\.7 to 0\.7"),
    ],
)
def test_shapes_that_cannot_be_are_refused(change: dict[str, Any], reason: str) -> None:
    good = TaperedSuperquadric(np.array([0.1, 0.2, 0.3]), np.array([0.5, 0.9]), np.array([0.0, 0.0]))
    with pytest.raises(ModelError, match=reason):
        replace(good, **change)


@pytest.mark.parametrize("seed", range(len(SHAPES)))
def test_signed_distances_are_those_along_the_normal(seed: int) -> None:
    """To first order: what is left grows with the square of the distance."""
    shape = np.array(list(SHAPES.values())[seed])
    rng = np.random.default_rng(seed)
    points, normals = surface(shape, rng.uniform(-1.2, 1.2, 400), rng.uniform(-3, 3, 400))
    on_it, away = signed_distance(shape, points)
    np.testing.assert_allclose(on_it, 0, atol=1e-12)
    np.testing.assert_allclose(away, normals, atol=1e-6)
    for side in (1, -1):
        off = [np.abs(signed_distance(shape, points + side * d * normals)[0] - side * d) for d in (1e-3, 1e-4)]
        # on a box or a sphere nothing is left but digits
        assert (off[1] < off[0] / 50 + 1e-9).mean() > 0.97
        assert np.median(off[0]) < 0.05e-3
