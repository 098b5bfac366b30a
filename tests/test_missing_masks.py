"""Silhouettes that the user brings in place of plates, of which some frames have none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recordings import small_simulation

from tracker.bodies.body.description import load_body
from tracker.bodies.scene import Person, Scene
from tracker.cameras.frame import Frame
from tracker.foundation.resources import model_path
from tracker.images.analysis.silhouettes import SilhouetteAnalysis
from tracker.images.inspection import findings, first_in_view, survey
from tracker.images.sight import Sight
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Simulation


@pytest.fixture(scope="module")
def masked() -> Frame:
    """A frame with the silhouettes of its views."""
    simulation = small_simulation(n_frames=1)
    (frame,) = simulation.frames()
    scene = simulation.scene.with_poses((simulation.poses[0][0],))
    return replace(frame, masks=CpuSynthesis().silhouettes(scene))


@pytest.fixture(scope="module")
def walk() -> Simulation:
    """Two seconds of somebody who walks."""
    return small_simulation("walking_on_the_spot", n_frames=50)


@pytest.mark.parametrize("image_is_there", [True, False])
def test_a_view_without_its_mask_in_a_frame_is_a_view_that_is_missing(masked: Frame, image_is_there: bool) -> None:
    images = masked.images if image_is_there else (None, *masked.images[1:])
    whole = SilhouetteAnalysis().observe(Sight(masked), None)
    lacking = SilhouetteAnalysis().observe(Sight(replace(masked, images=images, masks=(None, *masked.masks[1:]))), None)
    assert whole.views[0] is not None
    assert lacking.views[0] is None
    for one, other in zip(whole.views[1:], lacking.views[1:], strict=True):
        assert one is not None
        assert other is not None
        np.testing.assert_array_equal(one.edges, other.edges)


def test_who_walks_in_is_waited_for_though_the_first_frame_lacks_a_mask(masked: Frame) -> None:
    nobody = tuple(np.zeros_like(mask) for mask in masked.masks)
    shown = [(nobody[0], None, None, None), nobody, nobody, masked.masks, masked.masks]
    frames = [replace(masked, index=n, time_s=n / 25, masks=masks) for n, masks in enumerate(shown)]
    assert first_in_view(frames, (None,) * 4) == 3
    assert first_in_view([replace(frame, masks=()) for frame in frames], (None,) * 4) is None


def test_masks_tell_as_plates_do_that_the_model_has_another_size(walk: Simulation) -> None:
    small = load_body(model_path("gavrila22"), 0.55)
    scene = Scene((Person("one", small, small.rest()),), walk.scene.rig)
    frames = []
    for frame in walk.frames():
        here = walk.scene.with_poses((walk.poses[0][frame.index],))
        frames.append(replace(frame, masks=CpuSynthesis().silhouettes(here)))
    for some in ([replace(frame, masks=()) for frame in frames], frames):
        plates = (None,) * 4 if some is frames else walk.plates
        assert any("a taller person" in told for told in findings(survey(some, scene, plates)))


@pytest.mark.filterwarnings("error")
def test_a_view_that_is_missing_throughout_is_looked_at_in_silence(walk: Simulation) -> None:
    frames = [replace(frame, images=(*frame.images[:3], None)) for frame in walk.frames()]
    findings(survey(frames, walk.scene, walk.plates))
