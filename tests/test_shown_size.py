"""How high persons are shown, and that tracking averages images that show them higher than is needed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from tracker.bodies.subject import Subject
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig, fitting_downscale, shown_px
from tracker.cameras.rig_layouts import save_rig
from tracker.foundation.errors import CalibrationError
from tracker.images.reading.video import VideoReading
from tracker.running.jobs.track import TrackJob


def ring(size: tuple[int, int], focal_px: float, apart_m: float = 5.0) -> Rig:
    places = [(apart_m, 0.0, 1.2), (0.0, apart_m, 1.2), (-apart_m, 0.0, 1.2), (0.0, -1.2 * apart_m, 1.2)]
    target = np.array([0.0, 0.0, 1.0])
    return Rig(tuple(Camera.looking_at(f"c{k}", size, focal_px, place, target) for k, place in enumerate(places)))


def test_the_height_is_that_in_the_view_that_shows_it_smallest() -> None:
    rig = ring((720, 576), 800.0)
    farthest = rig.cameras[3]
    ends = farthest.project(np.array([[0.0, 0.0, 0.15], [0.0, 0.0, 1.85]]))
    assert shown_px(rig) == pytest.approx(np.ptp(ends[:, 1]), rel=0.02)


def test_a_place_behind_a_camera_has_no_say() -> None:
    rig = ring((720, 576), 800.0)
    turned = Camera.looking_at("away", (720, 576), 800.0, (9.0, 0.1, 1.2), np.array([20.0, 0.1, 1.2]))
    with_turned = Rig((*rig.cameras, turned))
    assert with_turned.cameras[-1].in_camera(with_turned.middle)[2] < 0
    assert shown_px(with_turned) == pytest.approx(shown_px(rig), rel=0.2)
    assert fitting_downscale(Rig((turned,))) == 1


@pytest.mark.parametrize(
    ("size", "focal_px", "factor"),
    [
        ((720, 576), 800.0, 1),
        ((1920, 1080), 2000.0, 1),
        ((1920, 1080), 2400.0, 2),
        ((1080, 1920), 2400.0, 2),
        ((3840, 2160), 4800.0, 4),
        ((1280, 720), 4000.0, 1),
        ((640, 480), 500.0, 0.5),
        ((360, 288), 400.0, 0.5),
        ((1280, 720), 600.0, 0.5),
        ((1280, 720), 850.0, 1),
        ((1920, 1080), 600.0, 1),
    ],
)
def test_images_are_averaged_or_enlarged_until_persons_are_some_300_px_high(
    size: tuple[int, int], focal_px: float, factor: float
) -> None:
    rig = ring(size, focal_px)
    assert fitting_downscale(rig) == factor
    averaged = rig.downscaled(factor)
    assert {camera.downscale for camera in averaged.cameras} == {factor}
    assert fitting_downscale(averaged) == 1
    assert shown_px(averaged) == pytest.approx(shown_px(rig) / factor)


def test_averaging_twice_is_averaging_over_the_product() -> None:
    once, twice = ring((1920, 1080), 2400.0).downscaled(6), ring((1920, 1080), 2400.0).downscaled(2).downscaled(3)
    for one, other in zip(once.cameras, twice.cameras, strict=True):
        np.testing.assert_allclose(one.matrix, other.matrix)
        assert (one.size, one.downscale) == (other.size, other.downscale)


def test_tracking_averages_large_images_unless_told_otherwise(tmp_path: Path) -> None:
    """Nobody need know that persons are followed best where they are some hundred pixels high."""
    save_rig(ring((3840, 2160), 4800.0), tmp_path / "rig.toml")
    reading = VideoReading(path=str(tmp_path / "{view}.mp4"), rig=tmp_path / "rig.toml")
    persons = (Subject(name="anna", stature_m=1.7),)
    assert reading.downscale is None
    assert TrackJob(reading=reading, persons=persons).reading.downscale == 4  # type: ignore[attr-defined]
    for given in (1, 3, 0.5):
        job = TrackJob(reading=replace(reading, downscale=given), persons=persons)
        assert job.reading.downscale == given  # type: ignore[attr-defined]
    for unfit in (0, 0.7, 17):
        with pytest.raises(ValidationError, match="downscale"):
            replace(reading, downscale=unfit)


def test_a_rig_that_cannot_be_read_is_told_when_it_is_opened(tmp_path: Path) -> None:
    reading = VideoReading(path=str(tmp_path / "{view}.mp4"), rig=tmp_path / "none.toml")
    job = TrackJob(reading=reading, persons=(Subject(name="anna", stature_m=1.7),))
    with pytest.raises(CalibrationError, match=r"none\.toml"):
        job.open()
