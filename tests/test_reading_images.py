"""Reading images: numbers, cut files, formats."""

from __future__ import annotations

import dataclasses
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numbered_pictures import (
    N_FRAMES,
    VIEWS,
    images,
    picture,
    seen,
    shown,
    write_images,
)

from tracker.foundation.errors import SequenceError
from tracker.images.reading._pictures import Lines, of_one_field
from tracker.images.reading.images import intact_image


def test_what_is_appended_to_a_jpeg_does_no_harm_and_a_preview_in_it_hides_no_cut(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    whole = cv2.imencode(".jpg", rng.integers(0, 255, (60, 80, 3), dtype=np.uint8))[1].tobytes()
    small = cv2.imencode(".jpg", np.zeros((8, 8, 3), dtype=np.uint8))[1].tobytes()
    preview = whole[:2] + b"\xff\xe1" + (len(small) + 2).to_bytes(2, "big") + small + whole[2:]
    path = tmp_path / "a.jpg"
    for content in (whole, preview, whole + 100_000 * b"motion", whole + small):
        path.write_bytes(content)
        np.testing.assert_array_equal(intact_image(path), cv2.imdecode(np.frombuffer(whole, np.uint8), 1))
    for content in (whole[: len(whole) // 2], preview[: len(preview) // 2], whole[:-2], whole[:3], b"\xff\xd8"):
        path.write_bytes(content)
        with pytest.raises(SequenceError, match="corrupt or truncated"):
            intact_image(path)


def test_pictures_that_are_whole_and_not_read_say_why(tmp_path: Path) -> None:
    path = tmp_path / "depth.tif"
    cv2.imwrite(str(path), np.ones((8, 9), dtype=np.float32))
    with pytest.raises(SequenceError, match="a TIFF of 32- or 64-bit numbers, expected 8 or 16 bits"):
        intact_image(path)
    cv2.imwrite(str(path), np.full((8, 9), 30_000, dtype=np.uint16))
    assert intact_image(path).max() == 30_000 // 256 + 0
    path = tmp_path / "bomb.png"
    cv2.imwrite(str(path), np.zeros((8, 9), dtype=np.uint8))
    content = bytearray(path.read_bytes())
    content[16:24] = (100_000).to_bytes(4, "big") * 2
    path.write_bytes(content)
    with pytest.raises(SequenceError, match="says to have 100000x100000 px, expected at most 268 million"):
        intact_image(path)


def test_image_numbers_need_not_start_at_0(copied: Path) -> None:
    for v, name in enumerate(VIEWS):
        shutil.rmtree(copied / "images" / name)
        write_images(copied / "images" / name, v, first=997)
    assert shown(images(copied, start=8, stop=10)) == [tuple((v, n) for v in range(3)) for n in (8, 9)]


def test_a_view_that_lacks_its_first_images_is_not_shifted(copied: Path) -> None:
    (copied / "images" / "north" / "img_0000.png").unlink()
    with pytest.raises(SequenceError, match=r'view "north" has no image for frame 0'):
        list(images(copied).open().frames())
    assert shown(images(copied, on_missing="skip"))[:2] == [((0, 0), None, (2, 0)), ((0, 1), (1, 1), (2, 1))]


def test_a_jpeg_cut_off_is_noticed(copied: Path) -> None:
    """OpenCV would fill the rest with grey."""
    for v, name in enumerate(VIEWS):
        for number in range(3):
            cv2.imwrite(str(copied / "images" / name / f"img_{number}.jpg"), picture(v, number))
    recording = dataclasses.replace(images(copied), path=str(copied / "images" / "{view}" / "img_{frame}.jpg"))
    assert len(shown(recording)) == 3
    spoilt = copied / "images" / "west" / "img_1.jpg"
    spoilt.write_bytes(spoilt.read_bytes()[:-40])
    with pytest.raises(SequenceError, match=r"west/img_1\.jpg: not an image that can be read"):
        shown(recording)
    assert [views[2] for views in shown(dataclasses.replace(recording, on_missing="skip"))] == [(2, 0), None, (2, 2)]


def test_images_are_sorted_by_number_not_by_letter(copied: Path) -> None:
    for name in VIEWS:
        for file in (copied / "images" / name).iterdir():
            number = int(re.sub(r"\D", "", file.name))
            file.rename(file.with_name(f"img_{number}.png"))
    assert [views[2] for views in shown(images(copied))] == [(2, number) for number in range(N_FRAMES)]


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda path: path.unlink(), r'view "north" has no image for frame 7'),
        (lambda path: path.write_bytes(path.read_bytes()[:80]), r"img_0007\.png: not an image that can be read"),
    ],
    ids=["missing", "truncated"],
)
def test_one_bad_image(copied: Path, spoil: Callable[[Path], None], reason: str) -> None:
    spoil(copied / "images" / "north" / "img_0007.png")
    with pytest.raises(SequenceError, match=reason):
        list(images(copied).open().frames())
    frames = list(images(copied, on_missing="skip").open().frames())
    assert [frame.index for frame in frames if frame.missing] == [7]
    assert frames[7].missing == (1,)
    assert seen(frames[8].images[1]) == (1, 8)


def test_image_patterns_that_cannot_work(copied: Path) -> None:
    with pytest.raises(SequenceError, match=r"no \{frame\}"):
        dataclasses.replace(images(copied), path=str(copied / "images" / "{view}" / "img.png")).open()
    with pytest.raises(SequenceError, match=r"no \{frame\} in the file name"):
        dataclasses.replace(images(copied), path=str(copied / "images" / "{view}_{frame}" / "img.png")).open()
    with pytest.raises(SequenceError, match=r'view "east": no image picture_\{frame\}\.png'):
        dataclasses.replace(images(copied), path=str(copied / "images" / "{view}" / "picture_{frame}.png")).open()


@pytest.mark.parametrize(("lines", "first"), [("odd", 0), ("even", 1)])
def test_lines_of_one_field_know_nothing_of_the_other(lines: Lines, first: int) -> None:
    rng = np.random.default_rng(0)
    for height in (2, 9, 12):
        one, other = rng.integers(0, 255, (2, height, 5, 3), dtype=np.uint8)
        woven = one.copy()
        woven[1 - first :: 2] = other[1 - first :: 2]
        made = of_one_field(woven, lines)
        np.testing.assert_array_equal(made, of_one_field(one, lines))
        np.testing.assert_array_equal(made[first::2], one[first::2])
    ramp = np.tile(np.arange(40, 64, 2, dtype=np.uint8)[:, None, None], (1, 5, 3))
    # a line at the border has one neighbour, and takes it as it is
    np.testing.assert_array_equal(of_one_field(ramp, lines)[1:-1], ramp[1:-1])


def test_interlaced_recordings_are_read_a_field_a_frame(copied: Path) -> None:
    for v, name in enumerate(VIEWS):
        for k in range(N_FRAMES - 1):
            woven = picture(v, k)
            woven[1::2] = picture(v, k + 1)[1::2]
            cv2.imwrite(str(copied / "images" / name / f"img_{k:04d}.png"), woven)
    frames = list(images(copied, lines="odd", stop=N_FRAMES - 1).open().frames())
    for k, frame in enumerate(frames):
        for v, image in enumerate(frame.images):
            np.testing.assert_array_equal(image, picture(v, k))
    later = next(iter(images(copied, lines="even", stop=2).open().frames()))
    np.testing.assert_array_equal(later.images[0], picture(0, 1))
