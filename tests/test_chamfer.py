"""The chamfer distance against a plain twin of the paper's equations, and what a search needs of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from observations import bent, four_views, ideal
from scipy.interpolate import RegularGridInterpolator
from scipy.spatial.distance import cdist

from tracker._native import chamfer_lookup, robust_mean
from tracker.bodies.body.description import load_body
from tracker.bodies.contours import Contours
from tracker.bodies.scene import Person, Scene
from tracker.evidence._shares import shares
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.similarity.chamfer import ChamferSimilarity
from tracker.foundation.arrays import Array, Array32
from tracker.foundation.resources import model_path
from tracker.images.sight import Observation, ViewObservation
from tracker.kernels.contours import directed_distances
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.objective import Objective

THETA = 12.0
rules = pytest.mark.parametrize("outliers", ["clamp", "reject"])


ANY_POSES = np.zeros((1, 22))
"""Poses for a synthesis that draws the same contours whatever the pose."""


class Drawn:
    """A synthesis of given contours: what is compared need not look like a body."""

    def __init__(self, contours: Contours) -> None:
        self.drawn = contours

    def contours(self, *asked: object) -> Contours:
        return self.drawn

    def directed_distances(
        self, scene: Scene, person: int, poses: Array, observation: Observation, theta: float, reject: bool
    ) -> Array:
        edges = observation.packed
        drawn = self.drawn.positions, self.drawn.counts
        found: Array = directed_distances(*drawn, *edges[:4], theta, reject)
        return found


def asked(contours: Contours, observation: Observation) -> Comparison:
    body = load_body(model_path("gavrila22"))
    scene = Scene((Person("one", body, body.rest()),), four_views())
    return Comparison(scene, 0, Drawn(contours), observation)  # type: ignore[arg-type]


def plain_mean(distances: Array, weights: Array, theta: float, outliers: str, slack: float = 0.0) -> float:
    """Eq. 2 of the paper for one set of points, with its outliers clamped at theta or rejected in two passes.

    The limit of the second pass may fall on a point: `slack` shifts it by that share.
    """
    if outliers == "clamp":
        distances = np.minimum(distances, theta)
        return float(np.average(distances, weights=weights)) if weights.sum() > 0 else theta
    near = distances <= theta
    distances, weights = distances[near], weights[near]
    if weights.sum() == 0:
        return theta
    mean = np.average(distances, weights=weights)
    sigma = np.sqrt(np.average((distances - mean) ** 2, weights=weights))
    kept = distances <= mean + 2 * sigma * (1 + slack)
    return float(np.average(distances[kept], weights=weights[kept]))


def plain_lookup(view: ViewObservation, pixels: Array, outside: float) -> Array:
    """Bilinear values of a chamfer image at pixels (N, 2)."""
    x, y = view.origin
    height, width = view.distance.shape
    axes = np.arange(y, y + height), np.arange(x, x + width)
    table = RegularGridInterpolator(axes, view.distance.astype(np.float64), bounds_error=False, fill_value=outside)
    values: Array = table(pixels[:, ::-1])
    return values


def plain_directed(contours: Contours, observation: Observation, theta: float, outliers: str) -> Array:
    """(B, V, 2) directed distances, the twin of `directed_distances`."""
    result = np.full((contours.n_poses, contours.n_views, 2), np.nan)
    for b, v in np.ndindex(contours.n_poses, contours.n_views):
        view, model = observation.views[v], contours.of(v, b)
        if view is None:
            continue
        matched = model.weights > 0
        pixels, weights = model.pixels[matched].astype(np.float64), model.weights[matched].astype(np.float64)
        to_scene = plain_lookup(view, pixels, theta + 1)
        gaps = cdist(view.edges[view.scene], pixels)
        to_model = gaps.min(axis=1) if len(pixels) else np.full(len(gaps), np.inf)
        result[b, v, 0] = plain_mean(to_scene, weights, theta, outliers)
        result[b, v, 1] = plain_mean(to_model, view.scene_weights.astype(np.float64), theta, outliers)
    return result


def scattered_view(rng: np.random.Generator, n_scene: int = 60) -> ViewObservation:
    """Edge points anywhere, half of them in the scene, and a chamfer image of a part of the image."""
    n = 2 * n_scene
    angles = rng.uniform(0, 2 * np.pi, n)
    return ViewObservation(
        edges=rng.uniform(0, 100, (n, 2)).astype(np.float32),
        directions=np.stack([np.cos(angles), np.sin(angles)], axis=1).astype(np.float32),
        segments=np.zeros(n, dtype=np.int64),
        accepted=np.ones(n, dtype=np.bool_),
        scene=rng.permutation(n)[:n_scene],
        scene_weights=rng.uniform(0.5, 3, n_scene).astype(np.float32),
        origin=(int(rng.integers(0, 20)), int(rng.integers(0, 20))),
        distance=rng.uniform(0, 1.5 * THETA, (70, 60)).astype(np.float32),
        reach=1.5 * THETA,
    )


def scattered_contours(rng: np.random.Generator, n_poses: int = 5, n_views: int = 3) -> Contours:
    """Samples anywhere, some outside of the image and some between parts; as many as may be in the first pose."""
    layout = (n_poses, n_views, 40)
    positions = rng.uniform(-10, 110, (*layout, 5)).astype(np.float32)
    between = rng.uniform(size=layout) < 0.2
    positions[..., 4] = np.where(between, 0, rng.uniform(0.5, 8, layout))
    counts = rng.integers(10, 41, layout[:2])
    counts[0] = 40
    parts = rng.integers(0, 6, layout)
    return Contours(positions, np.zeros((*layout, 3), dtype=np.float32), parts, between, counts)


def scattered(seed: int) -> tuple[Contours, Observation]:
    """Three views, the second one missing."""
    rng = np.random.default_rng(seed)
    return scattered_contours(rng), Observation((scattered_view(rng), None, scattered_view(rng, 31)))


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.floats(0, 100, width=32), st.floats(0.125, 8, width=32)), max_size=30),
    st.floats(1, 60),
    st.sampled_from(["clamp", "reject"]),
)
def test_the_robust_mean_is_that_of_the_paper(pairs: list[tuple[float, float]], theta: float, outliers: str) -> None:
    distances, weights = np.array(pairs, dtype=np.float64).reshape(-1, 2).T
    reject = outliers == "reject"
    found = robust_mean(distances.astype(np.float32), weights.astype(np.float32), len(pairs), theta, reject)
    expected = [plain_mean(distances, weights, theta, outliers, slack) for slack in (-1e-6, 0, 1e-6)]
    assert min(abs(found - value) for value in expected) < 1e-4 * theta
    assert 0 <= found <= theta * (1 + 1e-6)


@rules
def test_only_the_first_n_points_count(outliers: str) -> None:
    distances, weights = np.array([1, 3, 500], dtype=np.float32), np.array([1, 1, 7], dtype=np.float32)
    assert robust_mean(distances, weights, 2, 40.0, outliers == "reject") == pytest.approx(2)
    assert robust_mean(distances, weights, 0, 40.0, outliers == "reject") == 40


def test_points_are_rejected_twice() -> None:
    """Above theta first, then above mean + 2 sigma of what is left."""
    distances = np.array([1.0] * 20 + [30.0, 90.0], dtype=np.float32)
    weights = np.ones(22, dtype=np.float32)
    assert robust_mean(distances, weights, 22, 40.0, True) == pytest.approx(1)
    assert robust_mean(distances, weights, 22, 40.0, False) == pytest.approx((20 + 30 + 40) / 22)


def test_lookup_is_bilinear_and_ends_with_the_region() -> None:
    view = scattered_view(np.random.default_rng(1))
    flat, layout, *_ = Observation((None, view)).packed
    pixels = np.random.default_rng(2).uniform(-5, 105, (500, 2))
    found = [chamfer_lookup(flat, layout, 1, x, y, 77.0) for x, y in pixels]
    expected = plain_lookup(view, pixels, 77.0)
    assert 50 < (expected == 77).sum() < 450
    np.testing.assert_allclose(found, expected, atol=1e-4)
    (x, y), (height, width) = view.origin, view.distance.shape
    for row, column in ((0, 0), (0, width - 1), (height - 1, 0), (height - 1, width - 1), (7, 5)):
        assert chamfer_lookup(flat, layout, 1, x + column, y + row, 77.0) == pytest.approx(view.distance[row, column])


@rules
@pytest.mark.parametrize("seed", range(4))
def test_directed_distances_equal_their_plain_twin(outliers: str, seed: int) -> None:
    contours, observation = scattered(seed)
    flat, layout, scene, first, _ = observation.packed
    found = directed_distances(
        contours.positions, contours.counts, flat, layout, scene, first, THETA, outliers == "reject"
    )
    np.testing.assert_allclose(found, plain_directed(contours, observation, THETA, outliers), rtol=2e-4)
    assert np.isnan(found[:, 1]).all()
    assert np.isfinite(found[:, [0, 2]]).all()


@rules
def test_the_distance_is_the_mean_over_directions_and_views_present(outliers: Any) -> None:
    contours, observation = scattered(9)
    evidence = ContourEvidence(similarity=ChamferSimilarity(outlier_px=THETA, outliers=outliers))
    expected = plain_directed(contours, observation, THETA, outliers)[:, [0, 2]].mean(axis=(1, 2))
    np.testing.assert_allclose(evidence.distances(asked(contours, observation), ANY_POSES), expected, rtol=2e-4)


@rules
def test_without_model_or_scene_the_distance_is_that_of_an_outlier(outliers: Any) -> None:
    contours, observation = scattered(5)
    evidence = ContourEvidence(similarity=ChamferSimilarity(outlier_px=THETA, outliers=outliers))
    blank = Observation((None, None, None))
    # no view at all: as far as can be
    assert (evidence.distances(asked(contours, blank), ANY_POSES) >= THETA).all()
    hidden = asked(replace(contours, counts=np.zeros_like(contours.counts)), observation)
    np.testing.assert_array_equal(evidence.distances(hidden, ANY_POSES), THETA)
    account = evidence.account(hidden, ANY_POSES[0])
    assert account.distance_px == THETA
    assert np.isnan(account.per_part_px).all()
    assert not account.visible_px.any()
    dark = asked(contours, Observation(tuple(None if v is None else emptied(v) for v in observation.views)))
    np.testing.assert_array_equal(evidence.distances(dark, ANY_POSES), THETA)
    account = evidence.account(dark, ANY_POSES[0])
    np.testing.assert_allclose(account.per_part_px[account.visible_px > 0], 1.5 * THETA)
    np.testing.assert_allclose(account.explained_px, 0)
    assert not account.missed_px.any()


def emptied(view: ViewObservation) -> ViewObservation:
    """The view without an edge."""
    nothing = np.zeros((0, 2), dtype=np.float32)
    index, weight = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.float32)
    far: Array32 = np.full_like(view.distance, view.reach)
    return replace(
        view, edges=nothing, directions=nothing, segments=index, accepted=index > 0, scene=index,
        scene_weights=weight, distance=far,
    )  # fmt: skip


@rules
def test_the_account_is_the_distance_in_detail(outliers: Any) -> None:
    contours, observation = scattered(3)
    measure = ChamferSimilarity(outlier_px=THETA, outliers=outliers)
    evidence = ContourEvidence(similarity=measure, explained_px=4.0, missed_px=6.0)
    question = asked(contours, observation)
    account = evidence.account(question, ANY_POSES[0])
    assert account.distance_px == evidence.distances(question, ANY_POSES)[0]
    expected = plain_directed(contours, observation, THETA, outliers)[0].mean(axis=1)
    np.testing.assert_allclose(account.per_view_px, expected, rtol=2e-4)
    visible, missed, missed_total = np.zeros(7), np.zeros(7), 0.0
    for v, view in enumerate(observation.views):
        if view is None:
            continue
        model = contours.of(v)
        np.add.at(visible, model.parts, model.weights)
        gaps = cdist(view.edges[view.scene], model.pixels)
        far = gaps.min(axis=1) > 6.0
        np.add.at(missed, model.parts[gaps.argmin(axis=1)[far]], view.scene_weights[far])
        missed_total += view.scene_weights[far].sum()
    assert missed_total > 0
    np.testing.assert_allclose(account.visible_px[:7], visible, rtol=1e-5)
    np.testing.assert_allclose(account.missed_px[:7], missed, rtol=1e-5)
    assert np.isnan(account.per_part_px[6])
    assert ((account.per_part_px >= 0) & (account.per_part_px <= 40.0))[:6].all()
    assert ((account.explained_px >= 0) & (account.explained_px <= account.visible_px + 1e-9)).all()


@pytest.fixture(scope="module")
def truth() -> Scene:
    body = load_body(model_path("gavrila22"))
    return Scene((Person("one", body, bent(body)),), four_views())


@pytest.fixture(scope="module")
def observation(truth: Scene) -> Observation:
    return ideal(truth)


def objective_of(scene: Scene, observation: Observation, **settings: Any) -> Objective:
    evidence = ContourEvidence(similarity=ChamferSimilarity(**settings))
    return Objective(Comparison(scene, 0, CpuSynthesis(), observation), evidence)


def test_the_true_pose_explains_everything(truth: Scene, observation: Observation) -> None:
    objective, q = objective_of(truth, observation), truth.persons[0].q
    account = objective.evidence.account(objective.asked, q)
    # scene to model, a sample stands for 8 px of contour: the mean distance to the nearest of evenly spaced ones is 2
    assert account.distance_px < 1.3
    # of the neck a single sample is seen, half-way between the places where finer samples end
    assert np.nanmax(account.per_part_px[account.visible_px > 24]) < 0.75
    assert (account.explained_px > 0.95 * account.visible_px)[account.visible_px > 0].all()
    assert account.missed_px.sum() < 0.02 * account.visible_px.sum()


@pytest.mark.parametrize("sign", [-1, 1])
def test_every_parameter_off_the_truth_costs_the_more_the_farther(
    truth: Scene, observation: Observation, sign: int
) -> None:
    objective, q = objective_of(truth, observation), truth.persons[0].q
    body = truth.persons[0].body
    steps = np.where(body.rotates, np.radians(4), 0.02)
    slices = [objective(q + sign * np.arange(5)[:, None] * steps * unit) for unit in np.eye(body.dof)]
    rising = np.diff(slices, axis=1)
    assert (rising[:, 0] > 0).all(), [body.names[i] for i in np.flatnonzero(rising[:, 0] <= 0)]
    assert (rising > 0).mean() > 0.9
    # the least: 16 degrees of a bent elbow seen end-on raise the mean by 0.099 px, however dense the samples
    assert (np.array(slices)[:, 4] > np.array(slices)[:, 0] + 0.08).all()


def test_what_stands_still_from_batch_to_batch_changes_no_answer(truth: Scene, observation: Observation) -> None:
    body, q, rng = truth.persons[0].body, truth.persons[0].q, np.random.default_rng(2)
    elsewhere = np.array(q)
    elsewhere[body.group("right_leg")] += 0.2
    question, batches = Comparison(truth, 0, CpuSynthesis(), observation), []
    for start, limb in ((q, "left_arm"), (q, "left_arm"), (q, "right_arm"), (elsewhere, "left_arm"), (q, "left_arm")):
        poses = np.tile(start, (6, 1))
        poses[:, body.group(limb)] += rng.normal(scale=0.4, size=(6, 4))
        batches.append(poses)
    kept = [ChamferSimilarity().distances(question, poses) for poses in batches]
    alone = [[ChamferSimilarity().distances(question, pose[None])[0] for pose in poses] for poses in batches]
    np.testing.assert_allclose(kept, alone, rtol=1e-5)


def test_clamping_feels_a_displaced_limb_that_rejection_forgets(truth: Scene, observation: Observation) -> None:
    body, q = truth.persons[0].body, truth.persons[0].q
    turned = q + np.radians(30) * np.eye(body.dof)[body.index("left_arm_elevation")]
    rises = []
    for outliers in ("clamp", "reject"):
        right, wrong = objective_of(truth, observation, outliers=outliers)(np.stack([q, turned]))
        rises.append(wrong - right)
    assert rises[0] > 1.5 * rises[1] > 0


def test_a_limb_where_there_is_none_and_none_where_there_is_one(truth: Scene, observation: Observation) -> None:
    """The displaced arm is unexplained; what it left behind is missed, and counted for parts near by."""
    body, q = truth.persons[0].body, truth.persons[0].q
    turned = q + np.radians(60) * np.eye(body.dof)[body.index("left_arm_abduction")]
    objective = objective_of(truth, observation)
    before, after = (objective.evidence.account(objective.asked, pose) for pose in (q, turned))
    arm, others = body.parts_of("left_arm"), ~body.parts_of("left_arm")
    share = [account.of(arm).explained for account in (before, after)]
    assert share[0] > 0.95
    assert share[1] < 0.5
    leg = after.of(body.parts_of("right_leg"))
    assert (leg.explained_px > 0.95 * leg.visible_px)[leg.visible_px > 0].all()
    arm_length = before.visible_px[arm].sum()
    assert 0.3 * arm_length < after.missed_px.sum() < 1.5 * arm_length
    assert after.visible_px[others].sum() > 0.9 * before.visible_px[others].sum()


def test_sides_of_contrast_make_no_difference(truth: Scene, observation: Observation) -> None:
    turned = tuple(replace(v, directions=-v.directions) for v in observation.views if v is not None)
    poses = truth.persons[0].q + np.zeros((1, 22))
    one, other = (objective_of(truth, o)(poses) for o in (observation, Observation(turned)))
    np.testing.assert_array_equal(one, other)


def test_what_is_left_of_contours_and_edges_is_that_of_its_plain_twin(truth: Scene, observation: Observation) -> None:
    """With a view missing, one without edges, one without contours, and edges that no contour explains."""
    rng = np.random.default_rng(3)
    contours = CpuSynthesis().contours(truth, 0, truth.persons[0].q[None])
    counts = contours.counts.copy()
    counts[0, 3] = 0
    moved = contours.positions.copy()
    for v, count in enumerate(counts[0]):  # what lies behind is anything, and not to be looked at
        moved[0, v, :count, :2] += rng.normal(0, 6, (count, 2)).astype(np.float32)
        moved[0, v, count:] = np.nan
    contours = replace(contours, positions=moved, counts=counts)
    second = observation.views[1]
    assert second is not None
    bare = replace(second, scene=second.scene[:0], scene_weights=second.scene_weights[:0])
    seen = Observation((None, bare, *observation.views[2:]))
    found = shares(contours, seen, len(truth.shapes), (5.0, 10.0), (1.0, np.ones(4)))
    visible, distance, explained, missed = np.zeros((4, len(truth.shapes)))
    for v, view in enumerate(seen.views):
        if view is None:
            continue
        model = contours.of(v)
        column, row = (np.round(model.pixels).astype(int) - view.origin).T
        within = (column >= 0) & (row >= 0) & (column < view.distance.shape[1]) & (row < view.distance.shape[0])
        gaps = np.where(within, view.distance[row * within, column * within], view.reach)
        np.add.at(visible, model.parts, model.weights)
        np.add.at(distance, model.parts, model.weights * gaps)
        np.add.at(explained, model.parts, model.weights * (gaps <= 5.0))
        if len(view.scene) and len(model.parts):
            gap = cdist(view.edges[view.scene], model.pixels)
            far = gap.min(axis=1) > 10.0
            np.add.at(missed, model.parts[gap.argmin(axis=1)[far]], view.scene_weights[far])
    assert explained.sum() < visible.sum()
    assert missed.sum() > 0
    np.testing.assert_allclose(found.visible_px, visible, rtol=1e-6)
    np.testing.assert_allclose(found.explained_px, explained, rtol=1e-6)
    np.testing.assert_allclose(found.missed_px, missed, rtol=1e-6)
    np.testing.assert_allclose(found.per_part_px * visible, np.where(visible > 0, distance, np.nan), rtol=1e-5)
