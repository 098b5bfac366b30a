"""The shape space: what a parameter does, symmetry, and derivatives against finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from observations import bent

from tracker.acquisition._anatomy import Anatomy
from tracker.acquisition._residuals import asks_of, part_slopes
from tracker.acquisition.shape_space import ShapePrior, ShapeSpace, space_of
from tracker.bodies.body.description import read_description
from tracker.foundation.geometry.superquadrics import shape_derivatives, surface
from tracker.foundation.resources import model_path, models_folder

MODELS = sorted(path.stem for path in models_folder().glob("*.toml"))


def space(model: str = "gavrila22", **prior: object) -> ShapeSpace:
    return space_of(read_description(model_path(model)), ShapePrior(**prior))  # type: ignore[arg-type]


def some_shape(of: ShapeSpace, seed: int = 0, share: float = 1.0) -> np.ndarray:
    drawn = share * of.sigmas * np.random.default_rng(seed).normal(size=len(of.sigmas))
    return np.clip(drawn, of.limits[:, 0], of.limits[:, 1])


@pytest.mark.parametrize("model", MODELS)
def test_zero_is_the_general_model(model: str) -> None:
    of = space(model)
    general, same = Anatomy.of(of.description), Anatomy.of(of.described(np.zeros(len(of.names))))
    np.testing.assert_allclose(same.packed(), general.packed(), atol=1e-12)


@pytest.mark.parametrize("model", MODELS)
def test_every_parameter_has_a_name_of_its_own_and_does_something(model: str) -> None:
    of = space(model)
    assert len(set(of.names)) == len(of.names)
    assert (np.abs(of.directions).max(axis=0) > 0.01).all()
    body = of.body(some_shape(of))
    assert len(body.parts) == len(of.description.parts)


@pytest.mark.parametrize("model", MODELS)
def test_symmetric_shapes_stay_symmetric(model: str) -> None:
    of = space(model)
    general = Anatomy.of(of.description)
    if not np.allclose(general.mirrored(general.packed()), general.packed(), atol=2e-3):
        pytest.skip("the general model is not symmetric itself")
    change = of.directions @ some_shape(of)
    np.testing.assert_allclose(general.mirrored(change), change, atol=1e-9)


def test_without_symmetry_the_sides_differ() -> None:
    names = space(symmetric=False).names
    assert {"left_thigh.length", "right_thigh.length"} <= set(names)
    assert "right_thigh.length" not in space().names


def test_a_longer_thigh_is_longer_and_nothing_else() -> None:
    of = space()
    s = np.zeros(len(of.names))
    s[of.names.index("left_thigh.length")] = 0.1
    before, after = (
        dict(zip(b.landmark_names, (m.point for m in b.landmarks), strict=True)) for b in (of.body(0 * s), of.body(s))
    )

    def lengths(points: dict[str, np.ndarray]) -> dict[tuple[str, str], float]:
        return {link: float(np.linalg.norm(points[link[0]] - points[link[1]])) for link in of.description.links}

    old, new = lengths(before), lengths(after)
    for link, length in old.items():
        thigh = link in (("left_hip", "left_knee"), ("right_hip", "right_knee"))
        assert new[link] == pytest.approx(1.1 * length if thigh else length, abs=1e-9)


def test_the_pelvis_stays_between_the_hips() -> None:
    of = space()
    body = of.body(some_shape(of))
    points = dict(zip(body.landmark_names, (mark.point for mark in body.landmarks), strict=True))
    np.testing.assert_allclose(points["pelvis"], (points["left_hip"] + points["right_hip"]) / 2, atol=1e-9)


def test_derivatives_of_a_superquadric_are_its_finite_differences() -> None:
    rng = np.random.default_rng(1)
    shape, step = np.array([0.1, 0.15, 0.3, 0.5, 0.8, 0.2, -0.1]), 1e-6
    eta, omega = rng.uniform(-1.4, 1.4, 40), rng.uniform(-3, 3, 40)
    found = shape_derivatives(shape, surface(shape, eta, omega)[0])
    for k in range(7):
        move = step * np.eye(7)[k]
        expected = (surface(shape + move, eta, omega)[0] - surface(shape - move, eta, omega)[0]) / (2 * step)
        np.testing.assert_allclose(found[..., k], expected, atol=1e-8)


@pytest.mark.parametrize("model", ["gavrila22", "quadruped"])
def test_motion_by_shape_and_pose_is_its_finite_difference(model: str) -> None:
    of = space(model)
    s = some_shape(of, share=0.3)
    body = of.body(s)
    rng = np.random.default_rng(2)
    q = bent(body) if model == "gavrila22" else body.clamped(rng.normal(0.1, 0.2, body.dof))
    parts = np.repeat(np.arange(len(body.parts)), 3)
    eta, omega = rng.uniform(-1.2, 1.2, len(parts)), rng.uniform(-3, 3, len(parts))

    def points(shape: np.ndarray, pose: np.ndarray) -> np.ndarray:
        made = of.body(shape)
        local = [surface(made.shapes[p], a, b)[0] for p, a, b in zip(parts, eta, omega, strict=True)]
        placed = made.world_from_part(pose)[parts]
        return np.einsum("nij,nj->ni", placed[:, :3, :3], np.array(local)) + placed[:, :3, 3]

    by_part = part_slopes((body, of.neighbours(s), of.steps(s)), q)[parts]

    def motion(directions: np.ndarray) -> np.ndarray:
        return np.einsum("nk,nkj->nj", asks_of(body, q, points(s, q), parts, directions), by_part)

    found = np.stack([motion(np.tile(axis, (len(parts), 1))) for axis in np.eye(3)], axis=1)
    slanted = rng.normal(size=(len(parts), 3))
    slopes = motion(slanted)
    np.testing.assert_allclose(slopes, (slanted[:, :, None] * found).sum(axis=1), atol=1e-9)
    step = 1e-5
    for k in rng.choice(len(s), 25, replace=False):
        move = of.steps(s)[k] / abs(of.steps(s)[k]) * step * np.eye(len(s))[k]
        expected = (points(s + move, q) - points(s, q)) / move[k]
        np.testing.assert_allclose(found[:, :, k], expected, atol=2e-4)
    for k in range(body.dof):
        move = step * np.eye(body.dof)[k]
        expected = (points(s, q + move) - points(s, q - move)) / (2 * step)
        np.testing.assert_allclose(found[:, :, len(s) + k], expected, atol=1e-6)


def test_variants_are_the_bodies_they_stand_for() -> None:
    of = space()
    s = some_shape(of, share=0.4)
    found, q = of.neighbours(s), bent(of.body(s))
    parts, marks = found.placements(q)
    for k in range(0, len(s), 7):
        body = of.body(s + of.steps(s)[k] * np.eye(len(s))[k])
        np.testing.assert_allclose(found.shapes[k], body.shapes, atol=1e-12)
        np.testing.assert_allclose(parts[k], body.world_from_part(q), atol=1e-12)
        np.testing.assert_allclose(marks[k], body.landmarks_in_world(q), atol=1e-12)
