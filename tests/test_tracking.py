"""The tracking cycle on simulated recordings with exact truth."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from recordings import TrueStart, cycle_for, joint_errors_mm, small_simulation, with_images

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.errors import InitializationError
from tracker.synthesis.simulation.sequence import Recipe, simulate
from tracker.tracking.cycle import Cycle
from tracker.tracking.estimate import Status
from tracker.tracking.initialization import Stages
from tracker.tracking.loss import LossRule
from tracker.tracking.sequence import track
from tracker.tracking.start import Start

# A pixel is 12.5 mm at the person, an edge is found to a few tenths of one, and a joint hangs on dozens of edges.
TRACKED_MM = 8.0


class NoStart:
    """Never finds anybody."""

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        raise InitializationError("nobody there")


class OnceOnly:
    """Finds as another one does, and nobody when asked again."""

    def __init__(self, cycle: Cycle) -> None:
        self.starts = [cycle.initialization.start]

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        if not self.starts:
            raise InitializationError("nobody there")
        return self.starts.pop()(frame, scene, stages)


def test_a_start_near_the_truth_is_tracked_to_a_fraction_of_a_pixel():
    simulation = small_simulation()
    steps = list(track(simulation.frames(), simulation.scene, cycle_for(simulation, TrueStart(simulation))))
    assert [step.frame.index for step in steps] == list(range(8))
    assert [step.estimates[0].status for step in steps] == [Status.BOOTSTRAPPED] + 7 * [Status.TRACKED]
    errors = [joint_errors_mm(simulation, 0, step.frame.index, step.estimates[0].q).mean() for step in steps]
    assert max(errors) < TRACKED_MM


def test_bootstrapping_finds_the_pose_without_being_told():
    simulation = simulate(Recipe("squat", seconds=0.08))
    steps = list(track(simulation.frames(), simulation.scene, cycle_for(simulation)))
    assert steps[0].estimates[0].status is Status.BOOTSTRAPPED
    assert joint_errors_mm(simulation, 0, 0, steps[0].estimates[0].q).mean() < TRACKED_MM
    assert steps[0].start is not None
    axes = [len(fit.axes) for fit in steps[0].start.evidence[0] if fit is not None]
    assert len(axes) == len(simulation.scene.rig)
    assert max(axes) >= 2  # successive axes, where an arm hangs out


def test_persons_are_tracked_side_by_side():
    simulation = small_simulation(n_frames=4, persons=2)
    steps = list(track(simulation.frames(), simulation.scene, cycle_for(simulation, TrueStart(simulation))))
    for step in steps:
        for person, estimate in enumerate(step.estimates):
            assert not estimate.lost
            assert joint_errors_mm(simulation, person, step.frame.index, estimate.q).mean() < TRACKED_MM


def test_who_is_lost_stays_so_where_too_few_views_show_him(monkeypatch):
    """As the cycle is told in each frame, with for how long he has been lost before."""
    asked = []

    def told(sight, scene, synthesis, estimates, frames_lost, least_views):
        asked.append((*frames_lost, least_views))
        return [replace(one, status=Status.LOST) for one in estimates]

    monkeypatch.setattr("tracker.tracking.cycle_turn.still_lost", told)
    simulation = small_simulation(n_frames=4)
    cycle = cycle_for(simulation, TrueStart(simulation), loss=LossRule(restart_every=1000, rehearse=0))
    steps = list(track(simulation.frames(), simulation.scene, replace(cycle, initialization=OnceOnly(cycle))))
    assert [step.estimates[0].lost for step in steps] == [False, True, True, True]
    assert asked == [(0, 2), (1, 2), (2, 2)]


def test_a_loss_is_reported_and_the_person_found_again():
    simulation = small_simulation(n_frames=9)
    dark = with_images(simulation, lambda t, v, image: np.zeros_like(image) if 3 <= t < 6 else image)
    start = TrueStart(simulation)
    cycle = cycle_for(simulation, start, plates=(None,) * 4, loss=LossRule(restart_every=2))
    steps = list(track(dark, simulation.scene, cycle))
    statuses = [step.estimates[0].status for step in steps]
    assert statuses[3:6] == [Status.LOST] * 3
    assert statuses[6:] == [Status.RECOVERED, Status.TRACKED, Status.TRACKED]
    assert joint_errors_mm(simulation, 0, 8, steps[8].estimates[0].q).mean() < 2 * TRACKED_MM
    # In the frame of the loss, every second one after it, and when something explains the images again.
    assert start.asked == [0, 3, 5, 6]


@pytest.mark.parametrize("missing", [(0,), (1, 2)])
def test_missing_views_are_left_out(missing):
    simulation = small_simulation(n_frames=5)
    frames = with_images(simulation, lambda t, v, image: None if t >= 2 and v in missing else image)
    steps = list(track(frames, simulation.scene, cycle_for(simulation, TrueStart(simulation))))
    for step in steps[2:]:
        assert step.frame.missing == missing
        assert not step.estimates[0].lost
        assert np.isnan(step.estimates[0].account.per_view_px[list(missing)]).all()
        assert joint_errors_mm(simulation, 0, step.frame.index, step.estimates[0].q).mean() < 3 * TRACKED_MM


def test_nobody_found_in_the_first_frames_is_an_error():
    simulation = small_simulation(n_frames=4)
    steps = track(
        simulation.frames(), simulation.scene, cycle_for(simulation, NoStart(), loss=LossRule(start_within=3))
    )
    assert next(steps).estimates[0].status is Status.LOST
    assert next(steps).estimates[0].status is Status.LOST
    with pytest.raises(InitializationError, match="nobody there"):
        next(steps)


def test_the_same_images_give_the_same_poses():
    simulation = small_simulation(n_frames=3)
    runs = [
        [
            step.estimates[0].q
            for step in track(simulation.frames(), simulation.scene, cycle_for(simulation, TrueStart(simulation)))
        ]
        for _ in range(2)
    ]
    np.testing.assert_array_equal(runs[0], runs[1])


def test_opencv_has_one_thread_while_tracking_and_its_own_number_before_and_after():
    simulation = small_simulation(n_frames=3)
    before = cv2.getNumThreads()
    try:
        cv2.setNumThreads(3)
        steps = track(simulation.frames(), simulation.scene, cycle_for(simulation, TrueStart(simulation)))
        next(steps)
        assert cv2.getNumThreads() == 1
        steps.close()
        assert cv2.getNumThreads() == 3
    finally:
        cv2.setNumThreads(before)
