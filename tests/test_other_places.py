"""Limbs of a start pose are put where contours and colours speak for them, and stay where they are right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recordings import Staying, cycle_for, joint_errors_mm, small_simulation
from rounding import SINGLE, assert_alike

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.evidence.auto import AutoEvidence
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.measures.part_colours import colours_when_asked
from tracker.foundation.arrays import Array
from tracker.images.sight import Sight
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Simulation
from tracker.tracking.bootstrapping import bootstrap
from tracker.tracking.estimate import Status
from tracker.tracking.estimation.hybrid import HybridEstimation
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.initialization import Stages
from tracker.tracking.objective import NATS_PER_PX, Objective
from tracker.tracking.other_places import in_likeliest_places
from tracker.tracking.start import Start


@pytest.fixture(scope="module")
def filmed() -> Simulation:
    return small_simulation("squat", n_frames=24, size=(720, 576), model="human")


FRAME = 20


class Given:
    """Starts at a pose, right or wrong."""

    def __init__(self, start: Start) -> None:
        self.told = start

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        return self.told


@pytest.fixture(scope="module")
def objective(filmed: Simulation) -> Objective:
    """Of the frame in which arms are raised forwards and knees are bent."""
    alone = replace(filmed, recipe=replace(filmed.recipe, seconds=1 / 25), poses=(filmed.poses[0][FRAME:],))
    (frame,) = alone.frames()
    scene = filmed.scene.with_pose(0, filmed.poses[0][FRAME])
    sight, synthesis = Sight(frame, filmed.plates), CpuSynthesis()
    evidence = AutoEvidence()
    observed = evidence.observe(sight, synthesis.contours(scene))
    objective = Objective(Comparison(scene, 0, synthesis, observed), evidence)
    return replace(objective, colours=colours_when_asked(sight))


def moved(filmed: Simulation, **degrees: float) -> Array:
    body, q = filmed.scene.persons[0].body, filmed.poses[0][FRAME].copy()
    for name, value in degrees.items():
        q[body.index(name)] = np.radians(value)
    return body.clamped(q)


@pytest.mark.parametrize(
    "wrong",
    [
        {"right_arm_elevation": -20.0, "right_arm_extension": 10.0},
        {"left_arm_elevation": -10.0, "left_arm_abduction": 0.0, "left_arm_extension": 0.0},
        {"left_arm_abduction": 120.0, "right_arm_elevation": -30.0},
    ],
)
def test_a_limb_in_the_wrong_place_is_found(filmed, objective: Objective, wrong: dict[str, float]) -> None:
    estimate = TwistIcpEstimation().estimate(objective, moved(filmed, **wrong)[None])
    found = in_likeliest_places(objective, estimate)
    body = objective.body
    joints = [k for k, name in enumerate(body.landmark_names) if name.endswith(("elbow", "wrist", "knee", "ankle"))]
    assert joint_errors_mm(filmed, 0, FRAME, found.q)[joints].max() < 40
    after, before = objective.nats(np.array([found.q, estimate.q]))
    assert after <= before


def test_a_right_pose_stays(filmed, objective: Objective) -> None:
    estimate = TwistIcpEstimation().estimate(objective, filmed.poses[0][FRAME][None])
    found = in_likeliest_places(objective, estimate)
    assert found.q is estimate.q
    assert found.search_s > estimate.search_s


def test_only_limbs_asked_for_are_moved(filmed, objective: Objective) -> None:
    wrong = {"left_arm_abduction": 120.0, "right_arm_elevation": -30.0}
    estimate = TwistIcpEstimation().estimate(objective, moved(filmed, **wrong)[None])
    found = in_likeliest_places(objective, estimate, ("left_arm",))
    errors_mm = dict(zip(objective.body.landmark_names, joint_errors_mm(filmed, 0, FRAME, found.q), strict=True))
    assert errors_mm["left_wrist"] < 40
    assert errors_mm["right_wrist"] > 200


def test_a_head_is_looked_for_where_it_is_asked_for(filmed, objective: Objective) -> None:
    estimate = objective.estimate(moved(filmed, neck_elevation=50.0), np.eye(objective.body.dof), 1)
    head = objective.body.landmark_names.index("head_top")
    found = in_likeliest_places(objective, estimate, ("head",))
    assert joint_errors_mm(filmed, 0, FRAME, estimate.q)[head] > 100
    assert joint_errors_mm(filmed, 0, FRAME, found.q)[head] < 40


def test_a_weak_limb_is_looked_for_wherever_it_may_be(filmed, objective: Objective) -> None:
    wrong = moved(filmed, right_arm_abduction=120.0, right_arm_extension=0.0)
    stays = HybridEstimation(first=Staying(), search_below=0.0, trunk_above=1.0).estimate(objective, wrong[None])
    found = HybridEstimation(first=Staying()).estimate(objective, wrong[None])
    wrist = objective.body.landmark_names.index("right_wrist")
    off_mm = [joint_errors_mm(filmed, 0, FRAME, one.q)[wrist] for one in (stays, found)]
    assert off_mm[0] > 200 > 40 > off_mm[1]


def test_nothing_is_tried_of_who_is_lost(filmed, objective: Objective) -> None:
    wrong = objective.estimate(moved(filmed, right_arm_elevation=-20.0), np.eye(objective.body.dof), 1)
    lost = replace(wrong, status=Status.LOST)
    assert in_likeliest_places(objective, lost) is lost


def test_colours_decide_beside_distances_alone(filmed, objective: Objective) -> None:
    poses = np.array([filmed.poses[0][FRAME], moved(filmed, right_arm_elevation=-20.0)])
    contours = replace(objective, colours=None)
    assert_alike(contours.nats(poses), NATS_PER_PX * objective(poses), SINGLE)
    (lead,) = np.diff(contours.nats(poses))
    assert np.diff(objective.nats(poses)) > lead + 0.4


def test_an_arm_that_is_started_hanging_is_found_before_the_chest() -> None:
    """Along trunk and thigh it explains their contours: 3 % of its own is left over."""
    crossed = {"left_arm_elevation": 55.0, "left_arm_extension": 90.0, "left_arm_twist": 85.0} | {
        "right_arm_elevation": 35.0, "right_arm_extension": 85.0, "right_arm_twist": 85.0, "torso_twist": 140.0
    }  # fmt: skip
    simulation = small_simulation("squat", n_frames=1, size=(720, 576), model="human")
    body, q = simulation.scene.persons[0].body, simulation.poses[0][0].copy()
    for name, value in crossed.items():
        q[body.index(name)] = np.radians(value)
    simulation = replace(simulation, scene=simulation.scene.with_pose(0, q), poses=(q[None],))
    started = q.copy()
    for name, value in {"elevation": -2.0, "twist": -100.0, "extension": 19.0, "abduction": 4.0}.items():
        started[body.index(f"right_arm_{name}")] = np.radians(value)
    cycle = cycle_for(simulation, Given(Start((started,))), evidence=AutoEvidence())
    step = bootstrap(Sight(next(iter(simulation.frames())), simulation.plates), simulation.scene, cycle)
    joints = [body.landmark_names.index(f"{side}_{name}") for side in ("left", "right") for name in ("elbow", "wrist")]
    assert joint_errors_mm(simulation, 0, 0, step.estimates[0].q)[joints].max() < 60
