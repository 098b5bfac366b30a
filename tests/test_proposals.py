"""Every way to think of another pose of a limb keeps the contract; and one comparison decides what is taken."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from typing import cast

import numpy as np
import pytest
from observations import bent, ideal, objective_of
from test_best_first import Landscape

from tracker.bodies.body.description import load_body
from tracker.bodies.limbs import are_apart
from tracker.bodies.scene import Scene
from tracker.foundation.resources import model_path
from tracker.tracking import proposals
from tracker.tracking.objective import NATS_PER_PX, Objective
from tracker.tracking.verdict import LEAD_NATS, explains_better, likelier

WAYS = [name for _, name, _ in pkgutil.iter_modules(proposals.__path__)]


@pytest.fixture(scope="module", params=WAYS)
def propose(request: pytest.FixtureRequest) -> proposals.Proposal:
    module = importlib.import_module(f"tracker.tracking.proposals.{request.param}")
    return cast("proposals.Proposal", module.propose)


@pytest.fixture(scope="module")
def objective(truth: Scene) -> Objective:
    return objective_of(truth, ideal(truth))


def wrong(truth: Scene) -> np.ndarray:
    """An arm raised to the side that hangs down in truth, and a leg lifted."""
    body, q = truth.persons[0].body, truth.persons[0].q.copy()
    for name, degrees in (("left_arm_abduction", 70.0), ("right_leg_elevation", 50.0)):
        q[body.index(name)] += np.radians(degrees)
    return body.clamped(q)


def test_a_proposal_moves_the_limb_alone_or_its_partner(
    propose: proposals.Proposal, objective: Objective, truth: Scene
) -> None:
    body, q = objective.body, wrong(truth)
    for limb in body.limbs:
        poses, _ = propose(objective, q, limb)
        assert poses.shape[1] == body.dof
        np.testing.assert_array_equal(poses, [body.clamped(pose) for pose in poses] or poses)
        columns = [*body.group(limb), *body.group(body.partner_of(limb) or limb)]
        np.testing.assert_array_equal(
            np.delete(poses, columns, axis=1), np.tile(np.delete(q, columns), (len(poses), 1))
        )


def test_a_proposal_is_promising_and_the_same_every_time(
    propose: proposals.Proposal, objective: Objective, truth: Scene
) -> None:
    q = wrong(truth)
    for limb in objective.body.limbs:
        poses, _ = propose(objective, q, limb)
        most_px = proposals.PROMISING_NATS / NATS_PER_PX
        assert (objective(poses) < objective(q[None])[0] + most_px).all()
        np.testing.assert_array_equal(poses, propose(objective, q, limb)[0])


def slope(off_px: Callable[[np.ndarray], float]) -> Objective:
    """An objective that is a function of the pose."""
    body = load_body(model_path("gavrila22"))
    return cast("Objective", Landscape(body, lambda poses: np.array([off_px(q) for q in poses])))


@pytest.mark.parametrize("lead", [-3.0, 0.0, 0.5 * LEAD_NATS, 1.5 * LEAD_NATS])
def test_a_pose_with_a_limb_elsewhere_needs_a_lead_and_one_beside_it_does_not(lead: float) -> None:
    body = load_body(model_path("gavrila22"))
    here = bent(body)
    column = body.index("left_arm_abduction")
    for turn_deg, least in ((1.0, 0.0), (-60.0, LEAD_NATS)):
        there = here.copy()
        there[column] += np.radians(turn_deg)
        objective = slope(lambda q, there=there: 2.0 - lead / NATS_PER_PX * float(np.array_equal(q, there)))
        assert are_apart(body, there, here) == (abs(turn_deg) > 30)
        assert explains_better(objective, here, there) == (lead > least)
        assert not explains_better(objective, here, here)
        # never both ways
        assert not (explains_better(objective, here, there) and explains_better(objective, there, here))


def test_one_more_pose_never_worsens_what_is_chosen(objective: Objective, truth: Scene) -> None:
    body, right = objective.body, truth.persons[0].q
    rng, best = np.random.default_rng(3), objective.estimate(wrong(truth), np.eye(objective.body.dof), 1)
    for _ in range(20):
        other = body.clamped(right + rng.normal(0, 0.2, body.dof) * body.rotates)
        one = likelier(objective, best, objective.estimate(other, np.eye(body.dof), 1))
        assert one.distance_px <= best.distance_px
        assert one.evaluations == best.evaluations + 1
        best = one
    assert likelier(objective, best, best) is best
