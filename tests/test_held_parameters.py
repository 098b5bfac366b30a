"""Parameters that a calibration holds because the images do not determine them: at which value."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from bars import CLEAN, at_truth, images_of, recorded

from tracker.cameras.calibration._self_calibration import chosen_unknowns, self_calibrated
from tracker.cameras.calibration._start import bar_observations
from tracker.kernels.rows import BundleCameraRow


def test_a_time_offset_that_is_held_is_none() -> None:
    """A bar that hardly moves tells no time offset; nothing else of the camera is changed for it."""
    recording = recorded(13, 100, CLEAN)
    state, observations = at_truth(recording)
    speeds = bar_observations(np.array(recording.pixels), 0.004 * images_of(recording).velocities()).velocities
    wanted = chosen_unknowns(("camera_constant", "principal_point", "time_offset"), 4)
    views = [(camera.name, camera.size) for camera in recording.rig.cameras]
    found = self_calibrated(state, replace(observations, velocities=speeds), wanted, 0.1, views)
    assert {held.parameter for held in found.held} == {"time offset"}
    assert all(str(held).endswith("held at 0") for held in found.held)
    np.testing.assert_array_equal(found.state.cameras[:, BundleCameraRow.K4 :], 0.0)
