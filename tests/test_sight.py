"""What is seen in a frame against the plates: found once, in a region, and not used where it can't be right."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest
from recordings import TrueStart, cycle_for, joint_errors_mm, small_simulation, with_images

from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Image
from tracker.foundation.errors import InitializationError
from tracker.images.plate import Plate, changed
from tracker.images.sight import Sight
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Simulation
from tracker.tracking.doubts import Doubts
from tracker.tracking.initialization.auto import AutoInitialization
from tracker.tracking.initialization.pca import PcaInitialization
from tracker.tracking.sequence import track

SIZE = 240, 320
WHOLE = 0, 0, SIZE[1], SIZE[0]
PERSON = slice(60, 180), slice(140, 180)


def picture(seed: int) -> Image:
    """A coloured texture."""
    grain = cv2.GaussianBlur(np.random.default_rng(seed).standard_normal((*SIZE, 3)).astype(np.float32), (0, 0), 3.0)
    textured: Image = np.clip(110 + 300 * grain, 10, 240).astype(np.uint8)
    return textured


def with_person(plate: Image) -> Frame:
    image = plate.copy()
    image[PERSON] = (30, 40, 200)
    return Frame(7, 0.28, (image,))


def test_changes_are_found_once_and_again_in_a_larger_region() -> None:
    plate = picture(1)
    sight = Sight(with_person(plate), (Plate(plate),))
    assert sight.silhouette(0) is None
    whole = sight.changes(0, WHOLE)
    assert whole is not None
    assert sight.changes(0, (100, 20, 150, 200)) is whole
    expected = changed(with_person(plate).images[0], Plate(plate))  # type: ignore[arg-type]
    np.testing.assert_array_equal(whole.silhouette, expected.foreground)
    part = Sight(with_person(plate), (Plate(plate),))
    assert part.changes(0, (0, 0, 100, 240)) is not part.changes(0, WHOLE)
    assert sight.untrusted == {}


def test_what_is_made_of_all_views_is_kept_as_long_as_nothing_else_is_found_in_one() -> None:
    sight = Sight(Frame(0, 0.0, (None, None)))
    first, second, made = [1], [2], []

    def join(views: Sequence[list[int]]) -> int:
        made.append(views)
        return sum(one[0] for one in views)

    assert [sight.joined("sum", (first, second), join) for _ in range(2)] == [3, 3]
    assert len(made) == 1
    assert sight.joined("other", (first, second), join) == 3
    assert sight.joined("sum", (first, [5]), join) == 6
    assert len(made) == 3


def test_without_plate_or_image_nothing_has_changed() -> None:
    plate = picture(1)
    assert Sight(with_person(plate)).changes(0, WHOLE) is None
    assert Sight(Frame(0, 0.0, (None,)), (Plate(plate),)).changes(0, WHOLE) is None


@pytest.mark.parametrize(
    ("ratio", "fault"), [(1.0, ""), (0.65, ""), (1.5, ""), (0.4, "times the pixels of the model"), (2.5, "times")]
)
def test_a_foreground_of_another_size_than_the_model_is_not_used(ratio: float, fault: str) -> None:
    plate = picture(2)
    found = int(changed(with_person(plate).images[0], Plate(plate)).foreground.sum())  # type: ignore[arg-type]
    sight = Sight(with_person(plate), (Plate(plate),), np.array([found / ratio]))
    assert (sight.changes(0, WHOLE) is None) == bool(fault)
    assert (sight.silhouette(0) is None) == bool(fault)
    assert list(sight.untrusted) == ([0] if fault else [])
    assert fault in sight.untrusted.get(0, "")


def test_a_plate_full_of_sharp_lines_is_trusted() -> None:
    """A soft lens and noise make the median difference 5 to 7 grey levels there, in the same light."""
    rng, empty = np.random.default_rng(6), np.full((*SIZE, 3), 120, np.uint8)
    for x, y, u, v, grey in rng.integers(0, 320, (150, 5)).tolist():
        cv2.line(empty, (x, y), (u, v), (grey % 256,) * 3, 2)
    soft = cv2.GaussianBlur(with_person(empty).images[0], (0, 0), 0.6)  # type: ignore[arg-type]
    noisy = np.clip(soft + rng.normal(0, 3.0, soft.shape), 0, 255).astype(np.uint8)
    found = Sight(Frame(0, 0.0, (noisy,)), (Plate(empty),)).changes(0, WHOLE)
    assert found is not None
    assert found.silhouette[PERSON].mean() > 0.9


def test_a_model_that_is_hardly_in_the_view_tells_nothing() -> None:
    plate = picture(2)
    assert Sight(with_person(plate), (Plate(plate),), np.array([20.0])).changes(0, WHOLE) is not None


def test_the_plate_of_another_place_is_not_used() -> None:
    sight = Sight(with_person(picture(3)), (Plate(picture(4)),))
    assert sight.changes(0, WHOLE) is None
    assert "everything differs from the plate" in sight.untrusted[0]


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return small_simulation("arm_swing", n_frames=5)


def moved(index: int, view: int, image: Image | None) -> Image | None:
    """View 1 is pushed sideways at frame 3."""
    return np.roll(image, 40, axis=1) if image is not None and view == 1 and index >= 3 else image


def test_a_run_goes_on_without_the_foreground_of_a_view_and_says_so(simulation: Simulation) -> None:
    cycle = cycle_for(simulation, TrueStart(simulation))
    doubts, steps = Doubts(), []
    for step in track(with_images(simulation, moved), simulation.scene, cycle):
        doubts = doubts.after(step)
        steps.append(step)
    assert [list(step.untrusted) for step in steps[:3]] == [[], [], []]
    assert all(1 in step.untrusted for step in steps[3:])
    assert steps[1].model_px is not None
    assert f"foreground of {simulation.scene.rig.names[1]} not used in 2 (frames 3-4)" in doubts.sentence()


def test_masks_serve_in_place_of_plates(simulation: Simulation) -> None:
    def masked() -> Iterator[Frame]:
        for frame in simulation.frames():
            scene = simulation.scene.with_poses(tuple(poses[frame.index] for poses in simulation.poses))
            yield replace(frame, masks=tuple(CpuSynthesis().silhouettes(scene)))

    frame = next(masked())
    sight = Sight(frame)
    changes = sight.changes(1, (0, 0, 180, 288))
    assert changes is not None
    assert frame.masks[1] is not None
    np.testing.assert_array_equal(changes.silhouette[:, :180], frame.masks[1][:, :180])
    assert not changes.silhouette[:, 180:].any()
    cycle = cycle_for(simulation, AutoInitialization(), plates=(None,) * len(simulation.scene.rig))
    steps = list(track(masked(), simulation.scene, cycle))
    assert all(not step.estimates[0].lost for step in steps)
    assert all(step.overlap is not None and step.overlap.min() > 0.6 for step in steps)
    # a pixel is 12.5 mm at the person
    assert joint_errors_mm(simulation, 0, 4, steps[-1].estimates[0].q).mean() < 50


def test_a_start_in_another_room_is_refused(simulation: Simulation) -> None:
    cycle = replace(cycle_for(simulation, PcaInitialization()))
    other = with_images(simulation, lambda index, view, image: None if image is None else np.roll(image, 60, axis=1))
    with pytest.raises(InitializationError, match="differ everywhere from the background plates"):
        cycle.initialization.start(next(other), simulation.scene, cycle.stages)
