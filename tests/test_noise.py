"""Noisy and dark recordings: what is measured, and what images and plates are made of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tracker.bodies.subject import Subject
from tracker.foundation.arrays import Image
from tracker.images.operations.appearance import noise_grey, smoothed
from tracker.images.reading.images import ImageReading
from tracker.images.reading.video import VideoReading
from tracker.running.jobs.track import TrackJob
from tracker.synthesis.simulation.sequence import Recipe, write_sequence


def shots(sigma: float, flicker: float = 0.0, covered: float = 0.0) -> tuple[Image, Image]:
    """Two noisy images of one scene, in the second of which a part looks otherwise."""
    rng = np.random.default_rng(3)
    scene = cv2.GaussianBlur(rng.uniform(60, 190, (288, 360, 3)), (0, 0), 3)
    after = scene + flicker
    after[: int(covered * 288)] += 40
    first, second = (np.clip(np.round(one + sigma * rng.normal(size=one.shape)), 0, 255) for one in (scene, after))
    return first.astype(np.uint8), second.astype(np.uint8)


@pytest.mark.parametrize("sigma", [1.5, 3.0, 8.0])
@pytest.mark.parametrize("flicker", [0.0, 12.0])
def test_noise_is_measured_in_whatever_light(sigma: float, flicker: float) -> None:
    assert noise_grey(*shots(sigma, flicker)) == pytest.approx(sigma, rel=0.05)


def test_a_person_who_moves_is_no_noise() -> None:
    assert noise_grey(*shots(2.0, covered=0.05)) == pytest.approx(noise_grey(*shots(2.0)), rel=0.15)
    assert noise_grey(*shots(0.0, covered=0.15)) < 0.5


def recording(folder: Path, noise: float) -> VideoReading:
    recipe = Recipe("arm_swing", seconds=0.12, size=(320, 256), noise_grey=noise)
    write_sequence(recipe, folder)
    path, plates = str(folder / "{view}.mp4"), str(folder / "background" / "{view}.png")
    return VideoReading(path=path, rig=folder / "rig.toml", background=plates, downscale=1)


def test_rough_recordings_are_smoothed_where_plates_tell(tmp_path: Path) -> None:
    """What is compressed coarsely has no noise from frame to frame."""
    recipe = Recipe("arm_swing", seconds=0.12, size=(720, 576), constant_rate_factor=40)
    write_sequence(recipe, tmp_path / "coarse")
    path = str(tmp_path / "coarse" / "{view}.mp4")
    coarse = VideoReading(path=path, rig=tmp_path / "coarse" / "rig.toml", downscale=1)
    assert job(coarse).open().sequence.smoothing_px == 0  # type: ignore[attr-defined]
    plated = replace(coarse, background=str(tmp_path / "coarse" / "background" / "{view}.png"))
    assert job(plated).open().sequence.smoothing_px == 1  # type: ignore[attr-defined]
    write_sequence(replace(recipe, constant_rate_factor=14), tmp_path / "fine")
    fine = replace(plated, path=str(tmp_path / "fine" / "{view}.mp4"))
    assert job(fine).open().sequence.smoothing_px == 0  # type: ignore[attr-defined]


def test_dark_recordings_are_made_brighter(tmp_path: Path) -> None:
    """Plates with them; what is said stays; a bright recording, and one with a bright part, stays as it is."""
    usual = recording(tmp_path / "usual", 0.0)
    bright = usual.open()
    images = next(bright.frames()).images

    def darkened(folder: Path, light: int) -> VideoReading:
        """A third as bright, but for a corner."""
        (folder / "background").mkdir(parents=True)
        for name, image, plate in zip(bright.names, images, bright.plates, strict=True):
            assert image is not None
            assert plate is not None
            (folder / name).mkdir()
            for picture, path in ((image, f"{name}/0"), (plate.picture, f"background/{name}")):
                dark = (picture * 0.33).astype(np.uint8)
                dark[:40, :120] = np.maximum(dark[:40, :120], light)
                cv2.imwrite(str(folder / f"{path}.png"), dark)
        path, plates = str(folder / "{view}" / "{frame}.png"), str(folder / "background" / "{view}.png")
        return ImageReading(path=path, rig=usual.rig, background=plates, fps=25.0, downscale=1, smoothing_px=0.0)

    dark = darkened(tmp_path / "dark", 0)
    raw, found = dark.open(), job(dark).open().sequence
    gain = found.gain  # type: ignore[attr-defined]
    assert 2 < gain < 4.5
    for one, other in zip(next(raw.frames()).images, next(found.frames()).images, strict=True):
        assert one is not None
        np.testing.assert_array_equal(np.round(np.minimum(one * gain, 255)).astype(np.uint8), other)
    for plate, brighter in zip(raw.plates, found.plates, strict=True):
        assert plate is not None
        assert brighter is not None
        np.testing.assert_array_equal(
            np.round(np.minimum(plate.picture * gain, 255)).astype(np.uint8), brighter.picture
        )
    assert job(replace(dark, gain=1.5)).open().sequence.gain == 1.5  # type: ignore[attr-defined]
    assert job(usual).open().sequence.gain == 1  # type: ignore[attr-defined]
    assert job(darkened(tmp_path / "lit", 220)).open().sequence.gain == 1  # type: ignore[attr-defined]
    late = darkened(tmp_path / "late", 0)  # a lamp that goes on after two images
    for name in bright.names:
        lit = tmp_path / "late" / name / "2.png"
        (tmp_path / "late" / name / "0.png").rename(lit)
        for n in range(2):
            cv2.imwrite(str(lit.with_stem(str(n))), np.zeros_like(images[0]))
    assert job(late).open().sequence.gain == gain  # type: ignore[attr-defined]


def job(reading: VideoReading | ImageReading) -> TrackJob:
    return TrackJob(reading=reading, persons=(Subject(name="anna", model=Recipe().model_file),))


def test_noisy_recordings_are_smoothed_and_others_are_not(tmp_path: Path) -> None:
    noisy, usual = recording(tmp_path / "noisy", 10.0), recording(tmp_path / "usual", 3.0)
    raw, found = noisy.open(), job(noisy).open().sequence
    for before, after in zip(raw.frames(), found.frames(), strict=True):
        for one, other in zip(before.images, after.images, strict=True):
            assert one is not None
            assert other is not None
            np.testing.assert_array_equal(smoothed(one, 1.0), other)
    for plate, smooth in zip(raw.plates, found.plates, strict=True):
        assert plate is not None
        assert smooth is not None
        np.testing.assert_array_equal(smoothed(plate.picture, 1.0), smooth.picture)
    assert job(usual).open().sequence.smoothing_px == 0  # type: ignore[attr-defined]
    for given in (0.0, 0.7):
        told = job(replace(noisy, smoothing_px=given))
        assert told.open().sequence.smoothing_px == given  # type: ignore[attr-defined]
    # enlarged pictures have noise as wide as they are enlarged
    assert job(replace(noisy, downscale=0.5)).open().sequence.smoothing_px == 2  # type: ignore[attr-defined]
