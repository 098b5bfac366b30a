"""Best-first search on landscapes whose least place is known, and on contours."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
import pytest
from observations import bent, joint_errors_mm, objective_of, off

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Scene
from tracker.evidence.measures.account import Account
from tracker.foundation.arrays import Array
from tracker.images.sight import Observation
from tracker.tracking.estimate import Estimate
from tracker.tracking.estimation.best_first import BestFirstEstimation
from tracker.tracking.objective import NATS_PER_PX, Objective


@dataclass
class Landscape:
    """A known function in place of images; counts what is asked of it."""

    body: BodyModel
    height: Callable[[Array], Array]
    asked: list[Array] = field(default_factory=list)

    def __call__(self, poses: Array) -> Array:
        self.asked.append(np.array(poses))
        return self.height(poses)

    def nats(self, poses: Array) -> Array:
        return NATS_PER_PX * self(poses)

    def estimate(self, q: Array, covariance: Array, evaluations: int) -> Estimate:
        nothing = np.zeros(0)
        account = Account(float(self.height(q[None])[0]), nothing, nothing, nothing, nothing, nothing)
        return Estimate(q, covariance, account, 0.0, evaluations)

    @property
    def poses(self) -> Array:
        """(N, dof) all poses evaluated."""
        return np.concatenate(self.asked)

    def estimated(self, search: BestFirstEstimation, starts: Array) -> Estimate:
        return search.estimate(cast("Objective", self), starts)


def bowl(body: BodyModel, target: Array) -> Landscape:
    """Squared distance from a target in steps of 1 degree or 1 cm."""
    unit = np.where(body.rotates, np.radians(1), 0.01)
    return Landscape(body, lambda poses: (((poses - target) / unit) ** 2).sum(axis=1))


PAPER = {"range_deg": 15.0, "range_m": 0.10, "step_deg": 5.0, "step_m": 0.05}
CAREFUL: dict[str, Any] = {**PAPER, "patience": 100, "max_expansions": 100}


@pytest.mark.parametrize("seed", range(3))
def test_a_bowl_is_descended_to_the_nearest_lattice_point(body: BodyModel, seed: int) -> None:
    """Which is within half a step in every parameter."""
    target = bent(body) + 0.99 * off(body, 12.4, 0.09, seed) * np.random.default_rng(seed).uniform(size=body.dof)
    landscape = bowl(body, target)
    found = landscape.estimated(BestFirstEstimation(**CAREFUL), bent(body)[None])
    gap = np.abs(found.q - np.clip(target, *body.limits.T))
    assert (gap <= np.where(body.rotates, np.radians(2.5), 0.025) + 1e-9).all()
    assert np.isnan(found.covariance).all()
    steps = (found.q - bent(body)) / np.where(body.rotates, np.radians(5), 0.05)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)


def test_the_best_of_a_rugged_lattice_is_found_by_exhaustion(body: BodyModel) -> None:
    """With patience, best-first search sees every node of a small lattice, and takes the least."""
    columns = [body.index(name) for name in ("left_arm_abduction", "left_arm_elevation", "left_arm_extension")]
    rng = np.random.default_rng(5)
    table = {node: rng.uniform() for node in itertools.product(range(-3, 4), repeat=3)}
    start = bent(body)

    def height(poses: Array) -> Array:
        nodes = np.round((poses - start)[:, columns] / np.radians(5)).astype(int)
        return np.array([table[tuple(node)] for node in nodes.tolist()])

    landscape = Landscape(body, height)
    search = BestFirstEstimation(**PAPER, patience=400, max_expansions=400)
    q, n = search.search_group(cast("Objective", landscape), start, np.array(columns))
    assert height(q[None])[0] == min(table.values())
    assert n == len(landscape.poses) == len(np.unique(landscape.poses.round(9), axis=0)) == 7**3
    hasty = BestFirstEstimation(**PAPER, patience=400, max_expansions=5)
    assert hasty.search_group(cast("Objective", landscape), start, np.array(columns))[1] <= 1 + 5 * 6


def test_a_dip_behind_a_ridge_is_found_with_patience(body: BodyModel) -> None:
    """A descent stops at the ridge; best-first search goes on from the next best node."""
    column, start = body.index("right_leg_elevation"), bent(body)
    heights = np.array([9.0, 9.0, 9.0, 1.0, 2.0, 2.5, 0.0])
    landscape = Landscape(
        body, lambda poses: heights[np.round((poses - start)[:, column] / np.radians(5)).astype(int) + 3]
    )
    for patience, expected in ((1, 0), (8, 3)):
        search = BestFirstEstimation(**PAPER, patience=patience)
        q, _ = search.search_group(cast("Objective", landscape), start, np.array([column]))
        assert round((q - start)[column] / np.radians(5)) == expected


def test_patience_counts_from_the_last_improvement(body: BodyModel) -> None:
    column, start = body.index("right_leg_elevation"), bent(body)
    landscape = Landscape(body, lambda poses: poses[:, column])
    search = BestFirstEstimation(**PAPER, patience=1)
    q, _ = search.search_group(cast("Objective", landscape), start, np.array([column]))
    assert (q - start)[column] == pytest.approx(-np.radians(15))


def test_the_search_stays_in_range_and_limits(body: BodyModel) -> None:
    elbow, knee = body.index("left_arm_extension"), body.index("right_leg_extension")
    start = bent(body)
    start[elbow], start[knee] = body.limits[elbow, 0] + np.radians(7), body.limits[knee, 1]
    landscape = bowl(body, start - 10)
    found = landscape.estimated(BestFirstEstimation(**CAREFUL), start[None])
    assert (landscape.poses >= body.limits[:, 0] - 1e-9).all()
    assert (landscape.poses <= body.limits[:, 1] + 1e-9).all()
    departures = np.abs(landscape.poses - start)
    assert departures[:, body.rotates].max() == pytest.approx(np.radians(15))
    assert departures[:, ~body.rotates].max() == pytest.approx(0.10)
    assert found.q[elbow] == pytest.approx(start[elbow] - np.radians(5))
    assert found.evaluations == len(landscape.poses)


def test_groups_are_searched_in_turn_with_the_others_held(body: BodyModel) -> None:
    target = bent(body) + off(body, 10.0, 0.05, seed=2)
    landscape = bowl(body, target)
    landscape.estimated(BestFirstEstimation(**CAREFUL), bent(body)[None])
    changes = np.abs(np.diff(np.concatenate([bent(body)[None], landscape.poses]), axis=0)) > 1e-9
    last = [int(np.flatnonzero(changes[:, body.group(name)].any(axis=1))[-1]) for name in body.coarse_groups]
    first = [int(np.flatnonzero(changes[:, body.group(name)].any(axis=1))[0]) for name in body.coarse_groups]
    assert body.coarse_groups == ("torso_head", "arms", "legs")
    assert all(end <= begin for end, begin in zip(last[:-1], first[1:], strict=True))
    legs_only = bowl(body, target)
    found = legs_only.estimated(BestFirstEstimation(**CAREFUL, decomposition=("legs",)), bent(body)[None])
    changed = np.flatnonzero(np.abs(found.q - bent(body)) > 1e-9)
    assert sorted(changed.tolist()) == sorted(body.group("legs").tolist())


def test_the_search_begins_at_the_best_start_and_never_ends_worse(body: BodyModel) -> None:
    starts = bent(body) + np.stack([off(body, angle, 0.05, seed=3) for angle in (20, 7, 30)])
    landscape = bowl(body, bent(body))
    found = landscape.estimated(BestFirstEstimation(**PAPER), body.clamped(starts))
    np.testing.assert_array_equal(landscape.asked[1][0], body.clamped(starts)[1])
    assert found.distance_px <= landscape.height(body.clamped(starts)).min()


def test_halvings_refine_the_lattice(body: BodyModel) -> None:
    target = bent(body) + off(body, 9.3, 0.06, seed=4)
    found = [
        bowl(body, target).estimated(BestFirstEstimation(**CAREFUL, halvings=n), bent(body)[None]).q for n in range(4)
    ]
    gaps = np.abs(np.array(found) - np.clip(target, *body.limits.T))
    steps = np.where(body.rotates, np.radians(5), 0.05) / 2 ** np.arange(4)[:, None]
    inside = (np.abs(target - np.clip(target, *body.limits.T)) < 1e-12) & (target < body.limits[:, 1] - 0.1)
    assert (gaps <= steps / 2 + 1e-9)[:, inside].all()


def test_the_search_of_images_comes_within_a_step_of_the_truth(truth: Scene, observation: Observation) -> None:
    body, q = truth.persons[0].body, truth.persons[0].q
    start = body.clamped(q + off(body, 7.5, 0.05, seed=6))
    objective = objective_of(truth.with_pose(0, start), observation)
    found = BestFirstEstimation().estimate(objective, start[None])
    assert found.distance_px < 0.6 * objective(start[None])[0]
    assert joint_errors_mm(body, found.q, q).mean() < 0.7 * joint_errors_mm(body, start, q).mean()
