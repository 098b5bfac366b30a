"""Where somebody walks before one's own cameras: of equally good headings the usual one."""

from __future__ import annotations

import numpy as np

from tracker.bodies.body.description import load_body
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.resources import model_path
from tracker.synthesis.simulation.common_volume import best_heading_deg
from tracker.synthesis.simulation.movements import poses_of
from tracker.synthesis.simulation.sequence import Recipe


def test_of_equal_headings_that_nearest_to_the_usual_one_is_taken() -> None:
    """Cameras that see all of every way; -40 degrees are 320."""
    body, middle = load_body(model_path("gavrila22")), np.array([0.0, 0.0, 1.0])
    places = [(12.0, 0.0, 3.0), (0.0, 12.0, 3.0)]
    rig = Rig(tuple(Camera.looking_at(f"cam{k}", (640, 480), 300.0, place, middle) for k, place in enumerate(places)))
    heading = best_heading_deg(rig, body, poses_of("walk", body, np.linspace(0, 1.5, 8)), (0.0, 0.0))
    off = (heading - Recipe("walk").heading_deg + 180.0) % 360.0 - 180.0
    assert abs(off) <= 7.5  # every 15 degrees are tried
