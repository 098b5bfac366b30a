"""Limbs that jump where the images hardly say where they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recordings import TrueStart, cycle_for, joint_errors_mm, small_simulation

from tracker.account import Account
from tracker.arrays import Array
from tracker.comparison import Comparison
from tracker.contours import Contours
from tracker.doubt import Because, Doubt
from tracker.equations import Equations
from tracker.estimate import Estimate, Status
from tracker.evidence import Evidence, Memory
from tracker.sight import Sight
from tracker.simulation.sequence import Simulation
from tracker.tracking import track
from tracker.tracking.bridges import bridged
from tracker.tracking.cycle import Cycle, State
from tracker.trajectory import Step

JUMPS = range(5, 9)
"""Frames in which the left arm is found elsewhere."""


class Blind(Evidence):
    """Images that show nothing, or that like no pose but one of those found."""

    def __init__(self, found: tuple[Array, ...] = (), cost_px: float = 0.0) -> None:
        self.found, self.cost_px = found, cost_px

    def observe(self, sight: Sight, expected: Contours | None, memory: Memory = None) -> None:
        return None

    def distances(self, asked: Comparison, poses: Array) -> Array:
        return np.array([0.0 if any(np.array_equal(q, own) for own in self.found) else self.cost_px for q in poses])

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        return Equations.nothing(asked.body.dof)

    def account(self, asked: Comparison, q: Array) -> Account:
        n_parts = len(asked.body.parts)
        distance_px, none, all_px = float(self.distances(asked, q[None])[0]), np.zeros(n_parts), np.ones(n_parts)
        return Account(distance_px, np.zeros(len(asked.scene.rig)), none, all_px, all_px, none)


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation("two_elbow_rotation", n_frames=14)


@pytest.fixture(scope="module")
def cycle(simulation: Simulation) -> Cycle:
    return cycle_for(simulation, TrueStart(simulation))


@pytest.fixture(scope="module")
def steps(simulation: Simulation, cycle: Cycle) -> list[Step]:
    return list(track(simulation.frames(), simulation.scene, cycle))


def jumping(steps: list[Step]) -> list[Step]:
    """The steps with the left arm swung away for a while, as if it had been found there."""
    found, column = [], steps[0].scene.persons[0].body.index("left_arm_elevation")
    for step in steps:
        q = step.estimates[0].q.copy()
        q[column] += np.radians(60) * (step.frame.index in JUMPS)
        found.append(replace(step, estimates=(replace(step.estimates[0], q=q),), scene=step.scene.with_pose(0, q)))
    return found


def smoothed(steps: list[Step], cycle: Cycle) -> list[Step]:
    return bridged(steps, cycle, State.before(steps[0].scene), None)


def worst_mm(simulation: Simulation, steps: list[Step]) -> Array:
    return np.array([joint_errors_mm(simulation, 0, step.frame.index, step.estimates[0].q).max() for step in steps])


def poses_of(steps: list[Step]) -> list[Array]:
    return [step.estimates[0].q for step in steps]


def test_a_limb_that_jumps_where_nothing_is_seen_is_led_over(
    simulation: Simulation, cycle: Cycle, steps: list[Step]
) -> None:
    """It is called ambiguous there, its sigmas cover both places, and all else is as it was."""
    rough = jumping(steps)
    even = smoothed(rough, replace(cycle, evidence=Blind()))
    jumped = [rough[n].frame.index in JUMPS for n in range(len(rough))]
    assert worst_mm(simulation, rough)[jumped].min() > 300
    assert worst_mm(simulation, even)[jumped].max() < 60
    body, column = steps[0].scene.persons[0].body, steps[0].scene.persons[0].body.index("left_arm_elevation")
    others = np.setdiff1d(np.arange(body.dof), body.group("left_arm"))
    for one, other, jumps in zip(rough, even, jumped, strict=True):
        before, after = one.estimates[0], other.estimates[0]
        np.testing.assert_array_equal(after.q[others], before.q[others])
        reasons = {one.because: one.value > one.limit for one in after.doubts if one.limb == "left_arm"}
        assert reasons.get(Because.BRIDGED, False) == jumps
        np.testing.assert_array_equal(other.scene.persons[0].q, after.q)
        if jumps:
            assert np.sqrt(after.covariance[column, column]) > 0.9 * np.radians(30)
            assert other.frame is one.frame


@pytest.mark.parametrize("cost_px", [50.0, 0.25])
def test_images_that_speak_against_it_are_believed(cycle: Cycle, steps: list[Step], cost_px: float) -> None:
    """An arm that does jump, as far as is seen, has jumped; so has a fist whose way costs little less than none."""
    rough = jumping(steps)
    sure = replace(cycle, evidence=Blind(tuple(poses_of(rough)), cost_px))
    assert smoothed(rough, sure) is rough


def test_images_that_show_the_limb_elsewhere_are_asked(simulation: Simulation, cycle: Cycle, steps: list[Step]) -> None:
    rough = jumping(steps)
    even = smoothed(rough, cycle)
    assert worst_mm(simulation, even).max() < 0.3 * worst_mm(simulation, rough).max()


def test_what_moves_as_limbs_do_is_left_alone(cycle: Cycle, steps: list[Step]) -> None:
    assert smoothed(steps, replace(cycle, evidence=Blind())) is steps


@pytest.mark.parametrize("status", [Status.LOST, Status.RECOVERED, Status.BOOTSTRAPPED])
def test_nothing_leads_over_a_frame_in_which_the_person_was_not_tracked(
    cycle: Cycle, steps: list[Step], status: Status
) -> None:
    rough = jumping(steps)
    for n in (4, 9):
        rough[n] = replace(rough[n], estimates=(replace(rough[n].estimates[0], status=status),))
    even = smoothed(rough, replace(cycle, evidence=Blind()))
    for n in (n for n in range(len(rough)) if n not in JUMPS):
        np.testing.assert_array_equal(even[n].estimates[0].q, rough[n].estimates[0].q)


def test_what_was_in_doubt_of_other_limbs_is_so_still(
    cycle: Cycle, steps: list[Step], monkeypatch: pytest.MonkeyPatch
) -> None:
    """That one view alone shows a leg is no less so because an arm was moved."""

    def legs_too(objective: object, estimate: Estimate, within_px: float) -> Estimate:
        return estimate.doubting((Doubt("left_leg", Because.TWO_POSES, 0.1, 0.2),))

    monkeypatch.setattr("tracker.tracking.cycle_turn.with_vague_limbs", legs_too)
    even = smoothed(jumping(steps), replace(cycle, evidence=Blind()))
    assert all({"left_leg", "left_arm"} <= set(even[n].estimates[0].ambiguous) for n in JUMPS)
