"""Two persons are not in one place: the one whom the images speak for less is lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recordings import cycle_for, small_simulation

from tracker.bodies.scene import Person, Scene
from tracker.images.sight import Sight
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Simulation
from tracker.tracking.cycle_turn import objective_of
from tracker.tracking.doubt import Because
from tracker.tracking.estimate import Status
from tracker.tracking.overlap import judged_in_space, shared


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation("walking_on_the_spot", n_frames=1)


@pytest.mark.parametrize(("apart_m", "lost"), [(0.0, True), (0.05, True), (0.35, False), (1.0, False)])
def test_of_two_persons_in_one_place_the_one_who_leaves_more_over_is_lost(
    simulation: Simulation, apart_m: float, lost: bool
) -> None:
    person = simulation.scene.persons[0]
    q = person.q.copy()
    q[person.body.root.shifts[0]] += apart_m
    scene = Scene((Person("beside", person.body, q), person), simulation.scene.rig)
    cycle = cycle_for(simulation)
    observed = cycle.evidence.observe(
        Sight(next(iter(simulation.frames())), simulation.plates), CpuSynthesis().contours(simulation.scene)
    )
    nothing = np.eye(person.body.dof)
    one, other = (objective_of(Scene((who,), scene.rig), 0, cycle, observed) for who in scene.persons)
    right = other.estimate(person.q, nothing, 0)
    wrong = replace(one.estimate(q, nothing, 0), account=replace(right.account, missed_px=right.account.missed_px + 50))
    assert shared(scene, 0, 1) == pytest.approx(shared(scene, 1, 0))
    found = judged_in_space(scene, (wrong, right))
    assert [estimate.lost for estimate in found] == [lost, False]
    assert [doubt.because for estimate in found for doubt in estimate.doubts] == [Because.SAME_PLACE] * lost
    before = replace(wrong, status=Status.LOST)
    assert judged_in_space(scene, (before, right)) == (before, right), "who is lost is in nobody's place"
