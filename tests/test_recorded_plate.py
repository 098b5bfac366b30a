"""Plates made of the recording itself: right where everybody walks about, refused where somebody stays."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from tracker.foundation.arrays import Image
from tracker.images.reading._plates import _LEAST_KNOWN, N_SAMPLES, recorded_plate, recorded_plates
from tracker.images.reading.video import VideoReading
from tracker.kernels.changes import dominant_modes

SIZE = 240, 320


def room(seed: int = 0) -> Image:
    grain = cv2.GaussianBlur(np.random.default_rng(seed).standard_normal((*SIZE, 3)).astype(np.float32), (0, 0), 4.0)
    textured: Image = np.clip(120 + 400 * grain, 20, 230).astype(np.uint8)
    return textured


def filmed(boxes: Sequence[Sequence[tuple[int, int, int, int]]], light: float = 0.0) -> list[Image]:
    """Pictures of the room with boxes x, y, width, height of clothes in each, and noise; the light goes down."""
    rng, clothes, images = np.random.default_rng(1), room(7), []
    for k, seen in enumerate(boxes):
        image = room().astype(float)
        for x, y, width, height in seen:
            image[y : y + height, x : x + width] = 0.4 * clothes[60 : 60 + height, 60 : 60 + width] + (0, 20, 90)
        image *= 1 - light * k / len(boxes)
        images.append(np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8))
    return images


WALKING = [[(10 + 10 * k, 60, 40, 140)] for k in range(N_SAMPLES)]
STANDING = [[(140, 60, 40, 140), (100 + 8 * (k % 5), 70, 20, 60), (180 + 8 * (k % 4), 70, 20, 60)] for k in range(25)]
LEAVING = [[(140, 60, 40, 140)] if k < 16 else [(10 + 10 * (k - 16), 60, 40, 140)] for k in range(N_SAMPLES)]
STILL = [[(140, 60, 40, 140)]] * N_SAMPLES
PUSHED = [[] for _ in range(N_SAMPLES)]


def test_modes_are_those_of_the_plain_twin() -> None:
    rng = np.random.default_rng(3)
    pile = rng.choice([20, 25, 90, 200], (9, 12, 14, 1)).astype(np.uint8) + rng.integers(
        0, 4, (9, 12, 14, 3), dtype=np.uint8
    )
    plate, counts, rivals = np.empty((12, 14, 3), np.uint8), np.empty((12, 14), np.uint8), np.empty((12, 14), np.uint8)
    dominant_modes(pile, 12, plate, counts, rivals)
    for y in range(12):
        for x in range(14):
            colours = pile[:, y, x].astype(int)
            near = np.abs(colours[:, None] - colours[None]).max(axis=2)
            agree = (near <= 12).sum(axis=1)
            chosen = int(np.argmax(agree))
            assert counts[y, x] == agree.max()
            np.testing.assert_allclose(plate[y, x], colours[near[chosen] <= 12].mean(axis=0), atol=0.51)
            others = near[chosen] > 24
            assert rivals[y, x] == (agree[others].max() if others.any() else 0)


@pytest.mark.parametrize("light", [0.0, 0.3])
def test_who_walks_about_is_not_in_the_plate(light: float) -> None:
    found = recorded_plate(filmed(WALKING, light))
    assert found.known > (1 + _LEAST_KNOWN) / 2
    # in the light of the middle of the recording
    expected = room() * (1 - light / 2)
    assert np.percentile(np.abs(found.plate.picture - expected), 99) < 6


@pytest.mark.parametrize(
    ("boxes", "words"),
    [
        (STANDING, "a person stays in one place"),
        (LEAVING, "a person stays in one place|nobody moves"),
        (STILL, "nobody moves"),
        (WALKING[:5], "5 images to make it of"),
    ],
)
def test_who_stays_is_refused_and_said(
    boxes: list[list[tuple[int, int, int, int]]], words: str, caplog: pytest.LogCaptureFixture
) -> None:
    views = [filmed(WALKING), filmed(boxes)]
    with caplog.at_level(logging.WARNING, "tracker"):
        plates = recorded_plates(("east", "west"), lambda v: views[v])
    assert plates[0] is not None
    assert plates[1] is None
    assert [record.getMessage() for record in caplog.records] == [
        record.getMessage() for record in caplog.records if "west" in record.getMessage()
    ]
    assert len(caplog.records) == 1
    assert any(word in caplog.text for word in words.split("|"))


def test_a_camera_that_is_pushed_about_has_no_plate(caplog: pytest.LogCaptureFixture) -> None:
    images = [np.roll(image, 37 * k, axis=1) for k, image in enumerate(filmed(PUSHED))]
    assert recorded_plates(("east",), lambda v: images) == (None,)
    assert "did the camera move?" in caplog.text


@pytest.mark.parametrize(
    ("name", "view", "is_made"), [("N-WalkCircle", "FRONT", True), ("D-TwoElbowRot", "FRONT", False)]
)
def test_rendered_recordings(name: str, view: str, is_made: bool, data: Callable[[str], Path]) -> None:
    folder = data(f"room/{name}")
    reading = VideoReading(
        path=str(folder / "{view}.mp4"), rig=folder / "calibration.json", views=(view,), background="median"
    )
    plate = reading.open().plates[0]
    assert (plate is not None) == is_made
    if plate is not None:
        empty = cv2.imread(str(folder / "background" / f"{view}.png"))
        assert np.percentile(np.abs(plate.picture.astype(int) - empty), 99) < 15
