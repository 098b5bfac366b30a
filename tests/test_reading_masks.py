"""Reading masks beside the images."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest
from numbered_pictures import (
    HEIGHT,
    N_FRAMES,
    VIEWS,
    WIDTH,
    videos,
    write_images,
)

from tracker.foundation.errors import CalibrationError, SequenceError
from tracker.images.reading._pictures import read_painted
from tracker.images.reading.images import ImageReading


def write_masks(copied: Path, numbers: range = range(N_FRAMES), first: int = 0) -> None:
    """A square that moves a pixel a frame; the label of the person is not always 255."""
    for v, name in enumerate(VIEWS):
        (copied / name).mkdir(parents=True)
        for number in numbers:
            mask = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
            mask[10:20, 10 + number : 20 + number] = 1 + v
            cv2.imwrite(str(copied / name / f"{number + first:03d}.png"), mask)


def test_masks_come_with_their_frames(numbered: Path, tmp_path: Path) -> None:
    write_masks(tmp_path / "masks")
    masks = str(tmp_path / "masks" / "{view}" / "{frame}.png")
    reading = videos(numbered, masks=masks, start=3, stop=6, offsets={"north": 2})
    for frame in reading.open().frames():
        for v, shift in enumerate((0, 2, 0)):
            assert frame.position(v) == frame.index + shift
            mask = frame.mask(v)
            assert mask is not None
            assert mask.sum() == 100
            assert mask[10:20, 10 + frame.index + shift : 20 + frame.index + shift].all()
    large = next(dataclasses.replace(reading, downscale=0.5).open().frames()).mask(0)
    assert large is not None
    np.testing.assert_array_equal(large[1::2, ::2], next(reading.open().frames()).mask(0))
    small = next(dataclasses.replace(reading, downscale=2).open().frames()).mask(0)
    assert small is not None
    assert small.shape == (HEIGHT // 2, WIDTH // 2)
    assert abs(int(small.sum()) - 25) <= 5
    assert next(videos(numbered).open().frames()).masks == ()
    assert [one is not None for one in reading.open().known] == [True] * 3
    assert videos(numbered).open().known == (None,) * 3


def test_masks_of_images_are_numbered_as_they_are(tmp_path: Path, numbered: Path) -> None:
    for v, name in enumerate(VIEWS):
        write_images(tmp_path / "images" / name, v, first=17)
    write_masks(tmp_path / "masks", first=17)
    path, masks = str(tmp_path / "images" / "{view}" / "img_{frame}.png"), str(tmp_path / "masks/{view}/{frame}.png")
    frame = next(ImageReading(path=path, rig=numbered / "rig.toml", fps=25.0, masks=masks, start=4).open().frames())
    mask = frame.mask(1)
    assert mask is not None
    assert mask[10:20, 14:24].all()
    assert (frame.index, frame.position(1), frame.first_number) == (4, 4, 17)


def test_masks_that_are_missing_or_wrong_are_named(numbered: Path, tmp_path: Path) -> None:
    write_masks(tmp_path / "masks")
    (tmp_path / "masks" / "north" / "007.png").unlink()
    reading = videos(numbered, masks=str(tmp_path / "masks" / "{view}" / "{frame}.png"))
    with pytest.raises(SequenceError, match=r'masks of view "north": none numbered 7 for frame 7, 1 of 20 frames'):
        reading.open()
    frames = list(dataclasses.replace(reading, on_missing="skip").open().frames())
    assert frames[7].mask(1) is None
    assert frames[8].mask(1) is not None
    assert sum(1 for _ in dataclasses.replace(reading, stop=7).open().frames()) == 7
    with pytest.raises(SequenceError, match=r"no \{frame\} in the file name"):
        dataclasses.replace(reading, masks=str(tmp_path / "masks" / "{view}.png")).open()
    cv2.imwrite(str(tmp_path / "masks" / "east" / "000.png"), np.zeros((10, 10), dtype=np.uint8))
    with pytest.raises(CalibrationError, match='10x10 px, the images of view "east" have 64x48'):
        next(dataclasses.replace(reading, stop=2).open().frames())


@pytest.mark.parametrize("kind", ["jpg", "transparent", "grey and transparent", "opaque for nobody", "16 bits"])
def test_a_mask_is_what_is_neither_black_nor_transparent(kind: str, tmp_path: Path) -> None:
    """A JPEG rings around edges: silhouettes of all that is not 0 were 5 % larger."""
    shape = np.zeros((120, 160), dtype=np.uint8)
    cv2.circle(shape, (80, 60), 40, 255, -1)
    white = np.full_like(shape, 255)
    pictures = {
        "jpg": shape,
        "transparent": np.dstack([white, white, white, shape]),
        "grey and transparent": np.dstack([white // 2, white // 2, white // 2, shape]),
        "opaque for nobody": np.dstack([shape, shape, shape, 0 * shape]),
        "16 bits": (shape > 0).astype(np.uint16),
    }
    path = tmp_path / f"0.{'jpg' if kind == 'jpg' else 'png'}"
    cv2.imwrite(str(path), pictures[kind], [cv2.IMWRITE_JPEG_QUALITY, 80])
    np.testing.assert_array_equal(read_painted(path), shape > 0)


def test_nobody_in_a_jpeg_is_nobody(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "0.jpg"), np.zeros((48, 64), dtype=np.uint8))
    assert not np.any(read_painted(tmp_path / "0.jpg"))
