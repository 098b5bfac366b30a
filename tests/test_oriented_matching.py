"""Oriented matching, residuals and normal equations against plain twins and finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from observations import four_views, ideal, objective_of, off

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Scene
from tracker.cameras.rig import Rig
from tracker.evidence.measures.correspondences import Correspondences, correspondences
from tracker.foundation.arrays import Array, Integers
from tracker.images.sight import Observation
from tracker.kernels.contours import match_oriented, normal_equations


def directed_points(rng: np.random.Generator, n: int, reach: float = 60.0) -> Array:
    """(n, 5) pixel, unit direction, weight."""
    angles = rng.uniform(0, 2 * np.pi, n)
    columns = (*rng.uniform(0, reach, (2, n)), np.cos(angles), np.sin(angles), rng.uniform(0.5, 8, n))
    return np.stack(columns, axis=1).astype(np.float32)


def plain_pairs(model: Array, scene: Array, radius: float, cosine: float) -> set[tuple[int, int, int]]:
    """Twin of the matching in one view: (model, scene, direction of the match)."""
    gaps = np.linalg.norm(model[:, None, :2] - scene[None, :, :2], axis=2)
    agree = np.abs(model[:, 2:4] @ scene[:, 2:4].T) >= cosine
    gaps = np.where(agree & (gaps < radius) & (model[:, 4] > 0)[:, None], gaps, np.inf)
    forth = {(m, int(gaps[m].argmin()), 0) for m in range(len(model)) if np.isfinite(gaps[m]).any()}
    back = {(int(gaps[:, s].argmin()), s, 1) for s in range(len(scene)) if np.isfinite(gaps[:, s]).any()}
    return forth | back


def matched(samples: list[Array], scene: list[Array], gate: tuple[float, float], room: int = 999) -> Integers:
    """Pairs (N, 4) found by the kernel between views of model samples and scene points."""
    counts = np.array([len(view) for view in samples])
    positions = np.full((len(samples), counts.max() + 3, 5), np.nan, dtype=np.float32)
    for v, view in enumerate(samples):
        positions[v, : len(view)] = view
    rows = np.concatenate([view[np.argsort(view[:, 1], kind="stable")] for view in scene])
    first = np.cumsum([0, *map(len, scene)])
    pairs = np.full((room, 4), -1, dtype=np.int64)
    rows.setflags(write=False)
    first.setflags(write=False)
    n = match_oriented(positions, counts, rows, first, gate, pairs)
    assert (pairs[n:] == -1).all()
    return pairs[:n]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("radius", "angle_deg"), [(3.0, 90.0), (10.0, 30.0), (100.0, 10.0)])
def test_matching_equals_its_plain_twin(seed: int, radius: float, angle_deg: float) -> None:
    rng, cosine = np.random.default_rng(seed), float(np.cos(np.radians(angle_deg)))
    samples = [directed_points(rng, n) for n in (40, 0, 25)]
    samples[0][::5, 4] = 0
    scene = [directed_points(rng, n) for n in (70, 12, 0)]
    pairs = matched(samples, scene, (radius, cosine))
    expected = set()
    for v in range(3):
        order = np.argsort(scene[v][:, 1], kind="stable")
        start = sum(len(view) for view in scene[:v])
        expected |= {(v, m, s + start, way) for m, s, way in plain_pairs(samples[v], scene[v][order], radius, cosine)}
    assert len(pairs) == len(expected) > 5
    assert {tuple(pair) for pair in pairs.tolist()} == expected


def test_matching_stops_where_its_buffer_ends() -> None:
    rng = np.random.default_rng(1)
    samples, scene = [directed_points(rng, 30)], [directed_points(rng, 30)]
    everything = matched(samples, scene, (50.0, 0.0))
    assert len(everything) == 60
    np.testing.assert_array_equal(matched(samples, scene, (50.0, 0.0), room=41), everything[:41])


def drawn_pairs(truth: Scene, observation: Observation) -> tuple[Array, Correspondences]:
    """A pose off the truth and its correspondences."""
    body = truth.persons[0].body
    q = body.clamped(truth.persons[0].q + off(body, 3.0, 0.02, seed=1))
    return q, correspondences(objective_of(truth, observation).asked, q, 20.0, 40.0)


def with_lens(rig: Rig) -> Rig:
    """The rig with distorting lenses and sheared sensors."""
    matrix = np.array(rig.cameras[0].matrix)
    matrix[0, 1] = 3.0
    lens = np.array([-0.25, 0.08, 0.002, -0.001, 0.01])
    return Rig(tuple(replace(camera, matrix=matrix, distortion=lens) for camera in rig.cameras))


@pytest.mark.parametrize("rig", [four_views(), with_lens(four_views())], ids=["pinhole", "lens"])
def test_the_residual_is_linear_in_the_pose_as_its_jacobian_says(
    truth: Scene, observation: Observation, rig: Rig
) -> None:
    q, pairs = drawn_pairs(truth, observation)
    body, step = truth.persons[0].body, 1e-6
    assert len(pairs.points) > 300
    residual, jacobian = pairs.residual(body, q, rig)

    def moved(other: Array) -> Array:
        """Residuals with the model points carried along by their limbs."""
        motions = body.world_from_parameters(other) @ np.linalg.inv(body.world_from_parameters(q))
        motions = motions[pairs.parameters]
        points = np.einsum("nij,nj->ni", motions[:, :3, :3], pairs.points) + motions[:, :3, 3]
        return replace(pairs, points=points).residual(body, other, rig)[0]

    np.testing.assert_allclose(moved(q), residual, atol=1e-9)
    differences = [(moved(q + step * unit) - moved(q - step * unit)) / (2 * step) for unit in np.eye(body.dof)]
    np.testing.assert_allclose(jacobian, np.stack(differences, axis=1), atol=1e-3)


@pytest.mark.parametrize("robust_px", [2.0, 15.0, 1e6])
@pytest.mark.parametrize("rig", [four_views(), with_lens(four_views())], ids=["pinhole", "lens"])
def test_normal_equations_equal_their_plain_twin(
    truth: Scene, observation: Observation, rig: Rig, robust_px: float
) -> None:
    q, pairs = drawn_pairs(truth, observation)
    body = truth.persons[0].body
    residual, jacobian = pairs.residual(body, q, rig)
    weights = pairs.weights / (1 + (residual / robust_px) ** 2) ** 2
    # each pair as a sample of its own, of one pixel of contour
    order = np.arange(len(pairs.views))
    own = np.stack([pairs.views, order, order, np.zeros_like(order)], axis=1)
    samples = np.zeros((len(rig), len(order), 5), dtype=np.float32)
    samples[..., 2:4], samples[..., 4] = pairs.normals, pairs.weights
    points = np.tile(pairs.points.astype(np.float32), (len(rig), 1, 1))
    scene = np.c_[pairs.pixels, np.zeros((len(order), 3))].astype(np.float32)
    parts = np.tile(order, (len(rig), 1))
    matrix, vector, squares, total = normal_equations(
        own, samples, points, parts, pairs.parameters, scene, rig.packed, body.twists(q), body.moves, 1.0, robust_px
    )
    scale = np.sqrt(np.diag(jacobian.T @ (weights[:, None] * jacobian)))
    expected = jacobian.T @ (weights[:, None] * jacobian)
    np.testing.assert_allclose(matrix / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-6)
    np.testing.assert_allclose(vector / scale, jacobian.T @ (weights * residual) / scale, atol=1e-4)
    assert squares == pytest.approx((weights * residual**2).sum(), rel=1e-6)
    assert total == pytest.approx(weights.sum(), rel=1e-6)


def test_correspondences_are_of_the_person_asked_for(body: BodyModel, truth: Scene) -> None:
    beside = replace(truth.persons[0], name="two", q=truth.persons[0].q + np.eye(body.dof)[1] * 0.7)
    scene = Scene((truth.persons[0], beside), truth.rig)
    observation = ideal(scene)
    for person in range(2):
        objective, q = objective_of(scene, observation, person), scene.persons[person].q
        pairs = correspondences(objective.asked, q, 6.0, 40.0)
        assert len(pairs.points) > 200
        placed = body.world_from_part(q)
        local = [np.linalg.inv(m) @ np.c_[pairs.points, np.ones(len(pairs.points))].T for m in placed]
        sizes = [part.shape.size for part in body.parts]
        inside = [(np.abs(p[:3].T) <= 1.3 * size + 0.002).all(axis=1) for p, size in zip(local, sizes, strict=True)]
        owned = np.array(inside) & (body.part_parameters[:, None] == pairs.parameters)
        assert owned.any(axis=0).all()
        residual, _ = pairs.residual(body, q, scene.rig)
        assert np.median(np.abs(residual)) < 0.2
        np.testing.assert_allclose(np.linalg.norm(pairs.normals, axis=1), 1, atol=1e-5)
