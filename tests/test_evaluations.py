"""How many poses an estimation says it has compared, and how many it has."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import TrueStart, cycle_for, small_simulation

from tracker.evidence.contours import ContourEvidence
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.arrays import Array
from tracker.images.sight import Sight
from tracker.tracking.cycle_turn import objective_of
from tracker.tracking.estimation.hybrid import HybridEstimation


class Counting(ContourEvidence):
    """Contours that count the poses they are asked about."""

    asked: list[int] = []  # noqa: RUF012 - of the test, and the components are frozen

    def distances(self, asked: Comparison, poses: Array) -> Array:
        self.asked.append(len(poses))
        return super().distances(asked, poses)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_search_of_limbs_counts_its_poses_once(seed: int) -> None:
    simulation = small_simulation("two_elbow_rotation", n_frames=1)
    scene = simulation.scene.with_pose(0, simulation.poses[0][0])
    cycle = cycle_for(simulation, TrueStart(simulation), evidence=Counting())
    frame, body = next(iter(simulation.frames())), scene.persons[0].body
    observed = cycle.evidence.observe(Sight(frame, simulation.plates), None)
    off = np.where(body.rotates, 0.8 * np.random.default_rng(seed).normal(size=body.dof), 0.0)
    Counting.asked.clear()
    found = HybridEstimation().estimate(
        objective_of(scene, 0, cycle, observed), body.clamped(scene.persons[0].q + off)[None]
    )
    assert found.search_s > 0
    # equations and accounts count as well, and some answers are known already
    assert 0.5 * sum(Counting.asked) < found.evaluations < 1.4 * sum(Counting.asked)
