"""Reading: the right image for every frame and view, streamed; faults named or, where asked for, left out."""

from __future__ import annotations

import dataclasses
import shutil
import threading
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numbered_pictures import (
    FPS,
    HEIGHT,
    N_FRAMES,
    VIEWS,
    WIDTH,
    Recording,
    both,
    picture,
    pictures_of,
    seen,
    shown,
    videos,
    write_images,
    write_video,
)

from tracker.cameras.frame import Packed, Pictures
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import load_rig, save_rig
from tracker.foundation.errors import CalibrationError, SequenceError
from tracker.images import reading
from tracker.images.reading._pictures import check_size
from tracker.images.reading.video import VideoReading, VideoView


@both
def test_every_view_of_every_frame(numbered: Path, kind: Callable[..., Recording]) -> None:
    sequence = kind(numbered).open()
    assert isinstance(sequence, reading.Sequence)
    assert isinstance(kind(numbered), reading.Reading)
    assert sequence.rig.names == VIEWS
    assert sequence.fps == FPS
    assert sequence.plates == (None, None, None)
    frames = list(sequence.frames())
    assert len(frames) == sequence.n_frames == N_FRAMES
    for number, frame in enumerate(frames):
        assert frame.index == number
        assert frame.time_s == pytest.approx(number / FPS)
        assert frame.missing == ()
        assert [image.shape for image in frame.images if image is not None] == [(HEIGHT, WIDTH, 3)] * 3
        assert tuple(map(seen, frame.images)) == tuple((v, number) for v in range(3))


@both
def test_a_sequence_can_be_read_again(numbered: Path, kind: Callable[..., Recording]) -> None:
    sequence = kind(numbered, stop=4).open()
    first = [[seen(image) for image in frame.images] for frame in sequence.frames()]
    assert [[seen(image) for image in frame.images] for frame in sequence.frames()] == first


@both
@pytest.mark.parametrize(("start", "stop", "stride"), [(0, None, 1), (5, 12, 1), (3, None, 4), (19, 20, 7), (0, 1, 1)])
def test_ranges(numbered: Path, kind: Callable[..., Recording], start: int, stop: int | None, stride: int) -> None:
    recording = dataclasses.replace(kind(numbered), start=start, stop=stop, stride=stride)
    sequence = recording.open()
    expected = list(range(N_FRAMES))[start:stop:stride]
    frames = list(sequence.frames())
    assert [frame.index for frame in frames] == expected
    assert [seen(frame.images[1]) for frame in frames] == [(1, number) for number in expected]
    assert sequence.n_frames == len(expected)
    np.testing.assert_allclose([frame.time_s for frame in frames], np.array(expected) / FPS)


@both
@pytest.mark.parametrize(("start", "stop"), [(20, None), (0, 21), (5, 5), (7, 3)])
def test_ranges_outside_the_recording_are_refused(
    numbered: Path, kind: Callable[..., Recording], start: int, stop: int | None
) -> None:
    with pytest.raises(SequenceError, match=r"the recording has 20.*start and stop"):
        kind(numbered, start=start, stop=stop).open()


@both
def test_chosen_views_in_the_wanted_order(numbered: Path, kind: Callable[..., Recording]) -> None:
    recording = kind(numbered, views=("west", "east"), stop=2)
    assert recording.open().rig.names == ("west", "east")
    assert shown(recording) == [((2, 0), (0, 0)), ((2, 1), (0, 1))]


@both
def test_an_unknown_view_is_refused(numbered: Path, kind: Callable[..., Recording]) -> None:
    with pytest.raises(CalibrationError, match=r'no camera "nort".*did you mean "north"'):
        kind(numbered, views=("nort",)).open()


@both
def test_offsets_say_which_image_belongs_to_frame_0(copied: Path, kind: Callable[..., Recording]) -> None:
    write_video(copied / "north.mp4", pictures_of(1, range(3, N_FRAMES)))
    shutil.rmtree(copied / "images" / "north")
    write_images(copied / "images" / "north", 1, range(3, N_FRAMES), first=-3)
    recording = kind(copied, offsets={"east": 3, "west": 3})
    assert shown(recording) == [((0, n), (1, n), (2, n)) for n in range(3, N_FRAMES)]
    with pytest.raises(SequenceError, match=r'offsets: no view "wst".*did you mean "west"'):
        kind(copied, offsets={"wst": 3}).open()


@both
def test_views_of_unequal_length(copied: Path, kind: Callable[..., Recording]) -> None:
    write_video(copied / "north.mp4", pictures_of(1, range(14)))
    shutil.rmtree(copied / "images" / "north")
    write_images(copied / "images" / "north", 1, range(14))
    with pytest.raises(SequenceError, match=r"east 20, north 14, west 20.*on_missing"):
        kind(copied).open()
    recording = kind(copied, on_missing="skip")
    frames = list(recording.open().frames())
    assert len(frames) == N_FRAMES
    assert [frame.missing for frame in frames] == [()] * 14 + [(1,)] * 6
    assert shown(recording)[15] == ((0, 15), None, (2, 15))


@both
def test_a_negative_offset_leaves_a_view_out_of_the_first_frames(copied: Path, kind: Callable[..., Recording]) -> None:
    recording = kind(copied, offsets={"west": -2}, on_missing="skip")
    assert shown(recording)[:4] == [
        ((0, 0), (1, 0), None), ((0, 1), (1, 1), None), ((0, 2), (1, 2), (2, 0)), ((0, 3), (1, 3), (2, 1))
    ]  # fmt: skip


def test_copies_with_bars_are_told_apart_from_images_of_another_size() -> None:
    check_size("cam01", np.zeros((1920, 1088, 3), np.uint8), (1088, 1920))
    for width, bars in ((1080, True), (540, False)):
        with pytest.raises(CalibrationError, match="take the calibration of these images") as refused:
            check_size("cam01", np.zeros((1920, width, 3), np.uint8), (1088, 1920))
        assert ("black bars" in str(refused.value)) == bars


@both
def test_images_of_another_size_than_calibrated(copied: Path, kind: Callable[..., Recording]) -> None:
    smaller = load_rig(copied / "rig.toml").downscaled(2)
    save_rig(smaller, copied / "rig.toml")
    for policy in ("error", "skip"):
        with pytest.raises(CalibrationError, match=r"64x48 px, the rig was calibrated at 32x24"):
            list(kind(copied, on_missing=policy).open().frames())


@both
def test_images_turned_against_their_calibration(copied: Path, kind: Callable[..., Recording]) -> None:
    rig = load_rig(copied / "rig.toml")
    save_rig(Rig(tuple(camera.turned(1) for camera in rig.cameras)), copied / "rig.toml")
    with pytest.raises(CalibrationError, match=r"64x48 px, .* 48x64 px: are the images turned upright.*--upright"):
        list(kind(copied).open().frames())


@both
@pytest.mark.parametrize("name", ["rig.qca.txt", "rig.json", "opencv", "easymocap"])
def test_a_rig_in_any_layout_is_read(copied: Path, kind: Callable[..., Recording], name: str) -> None:
    before = load_rig(copied / "rig.toml")
    save_rig(before, copied / name, name if "." not in name else None)
    sequence = dataclasses.replace(kind(copied), rig=copied / name, views=VIEWS[::-1]).open()
    assert sequence.rig.names == VIEWS[::-1]
    np.testing.assert_allclose(sequence.rig.cameras[0].matrix, before.cameras[-1].matrix, atol=1e-9)


@both
@pytest.mark.parametrize("factor", [2, 3])
def test_downscaling_averages_the_images_and_scales_the_rig(
    numbered: Path, kind: Callable[..., Recording], factor: int
) -> None:
    full = kind(numbered, stop=3).open()
    small = kind(numbered, stop=3, downscale=factor, background=str(numbered / "plate_{view}.png")).open()
    size = WIDTH // factor, HEIGHT // factor
    assert [camera.size for camera in small.rig.cameras] == [size] * 3
    point = np.array([0.1, -0.2, 1.1])
    expected = (full.rig.project(point) - (factor - 1) / 2) / factor
    np.testing.assert_allclose(small.rig.project(point), expected, atol=1e-9)
    assert [plate.picture.shape for plate in small.plates if plate is not None] == [(size[1], size[0], 3)] * 3
    for large, little in zip(full.frames(), small.frames(), strict=True):
        for before, after in zip(large.images, little.images, strict=True):
            assert before is not None
            assert after is not None
            cut = before[: size[1] * factor, : size[0] * factor].astype(float)
            average = cut.reshape(size[1], factor, size[0], factor, 3).mean(axis=(1, 3))
            assert after.shape == average.shape
            assert np.abs(after - average).max() <= 0.51


@both
def test_enlarged_images_have_the_recorded_ones_between_their_pixels(
    numbered: Path, kind: Callable[..., Recording]
) -> None:
    full = kind(numbered, stop=3).open()
    large = kind(numbered, stop=3, downscale=0.5, background=str(numbered / "plate_{view}.png")).open()
    assert [camera.size for camera in large.rig.cameras] == [(2 * WIDTH, 2 * HEIGHT)] * 3
    assert large.sizes == ((2 * WIDTH, 2 * HEIGHT),) * 3
    point = np.array([0.1, -0.2, 1.1])
    np.testing.assert_allclose(large.rig.project(point), 2 * full.rig.project(point) + 0.5, atol=1e-9)
    assert [plate.picture.shape for plate in large.plates if plate is not None] == [(2 * HEIGHT, 2 * WIDTH, 3)] * 3
    for before, after in zip(full.frames(), large.frames(), strict=True):
        for one, other in zip(before.images, after.images, strict=True):
            assert one is not None
            assert other is not None
            again = other.reshape(HEIGHT, 2, WIDTH, 2, 3).mean(axis=(1, 3), dtype=float)
            assert np.abs(again - one).mean() < 0.1 * np.abs(one - one.mean(dtype=float)).mean() + 1


@both
def test_backgrounds(copied: Path, kind: Callable[..., Recording]) -> None:
    pictures = kind(copied, background=str(copied / "plate_{view}.png")).open().plates
    assert [seen(plate and plate.picture) for plate in pictures] == [(0, 0), (1, 0), (2, 0)]
    for v, name in enumerate(VIEWS):
        passing = [*pictures_of(v, range(9, 16)), *[picture(v, 2)] * 33]
        write_video(copied / f"empty_{name}.mp4", passing)
    clips = kind(copied, background=str(copied / "empty_{view}.mp4")).open().plates
    assert [seen(plate and plate.picture) for plate in clips] == [(0, 2), (1, 2), (2, 2)]
    assert all(plate is not None and not plate.picture.flags.writeable for plate in (*pictures, *clips))


@both
@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda path: path.unlink(), r'background of view "north": no file .*plate_north\.png'),
        (lambda path: path.write_bytes(b"no picture"), r'background of view "north": .*not an image'),
    ],
)
def test_a_background_that_cannot_be_read(
    copied: Path, kind: Callable[..., Recording], spoil: Callable[[Path], None], reason: str
) -> None:
    spoil(copied / "plate_north.png")
    with pytest.raises(SequenceError, match=reason):
        kind(copied, background=str(copied / "plate_{view}.png")).open()


def test_a_background_of_another_size(copied: Path) -> None:
    cv2.imwrite(str(copied / "plate_north.png"), picture(1, 0)[:40])
    with pytest.raises(CalibrationError, match=r'"north".*64x40'):
        videos(copied, background=str(copied / "plate_{view}.png")).open()


@both
def test_missing_files_are_named(copied: Path, kind: Callable[..., Recording]) -> None:
    (copied / "west.mp4").unlink()
    shutil.rmtree(copied / "images" / "west")
    with pytest.raises(SequenceError, match=r'view "west": no (file|folder) \S*west'):
        kind(copied).open()


@pytest.mark.parametrize("content", [b"these are words" * 100, None])
def test_a_view_that_cannot_be_opened(copied: Path, content: bytes | None) -> None:
    path = copied / "north.mp4"
    path.unlink()
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SequenceError, match=r'view "north": .*north\.mp4'):
        videos(copied).open()
    frames = list(videos(copied, on_missing="skip").open().frames())
    assert len(frames) == N_FRAMES
    assert all(frame.missing == (1,) for frame in frames)


def test_no_view_that_can_be_opened(copied: Path) -> None:
    for path in copied.glob("*.mp4"):
        path.write_bytes(b"these are words" * 100)
    with pytest.raises(SequenceError, match="is not a video"):
        videos(copied, on_missing="skip").open()


def test_stop_within_the_shortest_view_needs_nothing_more(copied: Path) -> None:
    write_video(copied / "north.mp4", pictures_of(1, range(14)))
    assert len(shown(videos(copied, stop=14))) == 14
    with pytest.raises(SequenceError, match=r"north 14"):
        videos(copied, stop=15).open()


@both
def test_a_path_without_view_is_refused(numbered: Path, kind: Callable[..., Recording]) -> None:
    recording = kind(numbered)
    fixed = dataclasses.replace(recording, path=recording.path.replace("{view}", "east"))
    with pytest.raises(SequenceError, match=r"no \{view\} in it, so all 3 views would show the same"):
        fixed.open()
    assert shown(dataclasses.replace(fixed, views=("east",), stop=1)) == [((0, 0),)]
    with pytest.raises(SequenceError, match=r"no \{view\} in it"):
        kind(numbered, background=str(numbered / "plate_east.png")).open()


def test_images_are_packed_until_they_are_asked_for(numbered: Path) -> None:
    """In half the memory, and the same to the bit whoever asks, whenever; changed ones are not packed."""
    reading = videos(numbered)
    (first, *_), bright = (list(one.open().frames()) for one in (reading, dataclasses.replace(reading, gain=1.5)))
    assert isinstance(first.images, Pictures)
    packed = first.images.packed[0]
    assert isinstance(packed, Packed)
    assert first.missing == ()
    assert packed.shape == first.images[0].shape
    again = first.unpacked()
    assert isinstance(again.images, tuple)
    for one, other in zip(first.images[:], again.images, strict=True):
        np.testing.assert_array_equal(one, other)
    assert isinstance(bright[0].images.packed[0], np.ndarray)


def test_frames_are_streamed(numbered: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No view is decoded further ahead than the frame after the one in hand."""
    lock, decoded = threading.Lock(), dict.fromkeys(VIEWS, 0)
    original = VideoView.held

    def counted(self: VideoView, index: int) -> Packed | None:
        with lock:
            decoded[self._path.stem] = max(decoded[self._path.stem], index + 1)
        return original(self, index)

    monkeypatch.setattr(VideoView, "held", counted)
    frames = videos(numbered).open().frames()
    assert max(decoded.values()) == 0
    for _ in range(5):
        frame = next(frames)
        assert max(decoded.values()) <= frame.index + 2
    frames.close()  # type: ignore[attr-defined]
    assert max(decoded.values()) < N_FRAMES


def test_abandoned_frames_leave_no_thread(numbered: Path) -> None:
    before = threading.active_count()
    frames = videos(numbered).open().frames()
    next(frames)
    frames.close()  # type: ignore[attr-defined]
    assert threading.active_count() == before


def test_a_real_recording(data: Callable[[str], Path]) -> None:
    root = data("balancing")
    recording = VideoReading(
        path=str(root / "videos" / "{view}.mp4"), rig=root / "calibration_balancing.json", stop=2, downscale=4
    )
    sequence = recording.open()
    assert sequence.rig.names == ("cam01", "cam02", "cam03", "cam04")
    assert sequence.fps == pytest.approx(60, rel=0.01)
    for frame in sequence.frames():
        for image, camera in zip(frame.images, sequence.rig.cameras, strict=True):
            assert image is not None
            assert (image.shape[1], image.shape[0]) == camera.size
