"""The first frame: images are looked at around the limbs found, wherever the start had them."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import TrueStart, cycle_for, joint_errors_mm, small_simulation

from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.evidence.contours import ContourEvidence
from tracker.foundation.arrays import Array
from tracker.images.sight import Observation, Sight
from tracker.synthesis.simulation.sequence import Simulation
from tracker.tracking import bootstrapping
from tracker.tracking.bootstrapping import bootstrap
from tracker.tracking.initialization import Stages
from tracker.tracking.start import Start


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation("squat", n_frames=1)


class Kicking(TrueStart):
    """Starts right but for a leg that kicks."""

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        body, q = scene.persons[0].body, super().start(frame, scene, stages).poses[0].copy()
        q[body.index("left_leg_elevation")] += np.radians(60)
        return Start((body.clamped(q),))


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> list[Contours | None]:
    """What contours are expected when images are looked at."""
    expected: list[Contours | None] = []
    observe = ContourEvidence.observe

    def spied(self: ContourEvidence, sight: Sight, where: Contours | None, *more: object) -> Observation:
        expected.append(where)
        return observe(self, sight, where, *more)

    monkeypatch.setattr(ContourEvidence, "observe", spied)
    return expected


def found_mm(simulation: Simulation, start: TrueStart) -> Array:
    step = bootstrap(
        Sight(next(iter(simulation.frames())), simulation.plates), simulation.scene, cycle_for(simulation, start)
    )
    return joint_errors_mm(simulation, 0, 0, step.estimates[0].q)


def test_a_limb_found_where_it_was_expected_takes_one_look(
    simulation: Simulation, looks: list[Contours | None]
) -> None:
    assert found_mm(simulation, TrueStart(simulation)).max() < 20
    assert len(looks) == 1


def test_images_are_looked_at_anew_around_a_limb_that_was_elsewhere(
    simulation: Simulation, looks: list[Contours | None]
) -> None:
    assert found_mm(simulation, Kicking(simulation)).max() < 20
    assert 2 <= len(looks) <= bootstrapping._ROUNDS
    first, last = (one.points for one in (looks[0], looks[-1]) if one is not None)
    assert first.shape != last.shape or not np.allclose(first, last)
