"""Limbs that one view alone shows may be elsewhere: users are told, and nothing else changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from doubted import in_doubt
from observations import ideal, objective_of

from tracker.bodies.limbs import are_apart, taken_over
from tracker.bodies.scene import Scene
from tracker.cameras.rig import Rig
from tracker.tracking.doubt import Because
from tracker.tracking.estimate import Estimate, Status
from tracker.tracking.loss import LossRule, judged
from tracker.tracking.objective import Objective
from tracker.tracking.single_view import with_vague_limbs

LIMBS = ("left_arm", "right_arm", "left_leg", "right_leg")
WITHIN_PX = LossRule().elsewhere_px


def seen_by(truth: Scene, n_views: int) -> tuple[Objective, Estimate]:
    """The true pose, judged by the first cameras."""
    scene = replace(truth, rig=Rig(truth.rig.cameras[:n_views]))
    body, q = scene.persons[0].body, scene.persons[0].q
    objective = objective_of(scene, ideal(scene))
    return objective, judged(body, objective.estimate(q, np.zeros((body.dof, body.dof)), 1), LossRule())


@pytest.mark.parametrize(("n_views", "vague"), [(1, LIMBS), (2, ("right_arm",)), (4, ())])
def test_limbs_that_one_view_alone_shows_are_vague(truth: Scene, n_views: int, vague: tuple[str, ...]) -> None:
    objective, estimate = seen_by(truth, n_views)
    assert estimate.ambiguous == ()
    found = with_vague_limbs(objective, estimate, WITHIN_PX)
    assert found.ambiguous == found.vague == vague
    # users are told; nothing is searched for it, and no pose changes
    assert found.limbs_in_doubt == ()
    assert found.q is estimate.q
    assert all(one.because is Because.TWO_POSES and one.value < one.limit == WITHIN_PX for one in found.doubts)
    assert with_vague_limbs(objective, found, WITHIN_PX) == found


def test_a_place_that_costs_more_does_not_make_a_limb_vague(truth: Scene) -> None:
    objective, estimate = seen_by(truth, 1)
    assert with_vague_limbs(objective, estimate, 1e-6) == estimate


def test_what_is_in_doubt_already_stays_so(truth: Scene) -> None:
    objective, estimate = seen_by(truth, 1)
    found = with_vague_limbs(objective, in_doubt(estimate, "left_leg"), WITHIN_PX)
    assert set(found.ambiguous) == set(LIMBS)
    assert found.limbs_in_doubt == ("left_leg",)


def test_nothing_is_tried_for_who_is_lost_or_where_nobody_asks(truth: Scene) -> None:
    objective, estimate = seen_by(truth, 1)
    lost = replace(estimate, status=Status.LOST)
    assert with_vague_limbs(objective, lost, WITHIN_PX) is lost
    assert with_vague_limbs(objective, estimate, 0.0) is estimate


def test_limbs_are_apart_where_a_joint_of_theirs_is_elsewhere(truth: Scene) -> None:
    body, q = truth.persons[0].body, truth.persons[0].q
    bent = q.copy()
    bent[body.index("left_arm_abduction")] -= np.radians(60)
    poses = np.array([q, bent, taken_over(body, bent, q, "left_arm")])
    assert are_apart(body, poses, q, body.landmarks_of("left_arm")).tolist() == [False, True, False]
    assert not are_apart(body, poses, q, body.landmarks_of("right_arm")).any()
    assert bool(are_apart(body, bent, q)) is True
