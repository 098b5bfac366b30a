"""Reading: the right image for every frame and view, streamed; faults named or, where asked for, left out."""

from __future__ import annotations

import dataclasses
import re
import shutil
import struct
import threading
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

from tracker import reading
from tracker.arrays import Image
from tracker.camera import Camera
from tracker.errors import CalibrationError, SequenceError
from tracker.reading._timeline import timeline_of
from tracker.reading.images import ImageReading, intact_image
from tracker.reading.video import VideoReading, VideoView, open_clip
from tracker.rig import Rig
from tracker.rig_layouts import load_rig, save_rig

Recording = VideoReading | ImageReading
WIDTH, HEIGHT, N_FRAMES, FPS = 64, 48, 20, 25
VIEWS = ("east", "north", "west")


def picture(view: int, number: int) -> Image:
    """The left half's grey tells the frame, the right half's the view; codecs change either by a level or two."""
    image = np.full((HEIGHT, WIDTH, 3), 10 + 10 * number, dtype=np.uint8)
    image[:, WIDTH // 2 :] = 40 + 60 * view
    return image


def seen(image: Image | None) -> tuple[int, int] | None:
    """View and frame that a picture shows."""
    if image is None:
        return None
    left, right = np.median(image[:, : image.shape[1] // 3]), np.median(image[:, -image.shape[1] // 3 :])
    return round((float(right) - 40) / 60), round((float(left) - 10) / 10)


def write_video(path: Path, pictures: list[Image], fps: int = FPS, gop: int = 12) -> None:
    """H.264 with its header at the front of the file."""
    options = {"movflags": "faststart"} if path.suffix == ".mp4" else {}
    with av.open(str(path), "w", options=options) as container:
        stream = container.add_stream("libx264", rate=fps)
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.gop_size = gop
        for image in pictures:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        container.mux(stream.encode())


def pictures_of(view: int, numbers: range = range(N_FRAMES)) -> list[Image]:
    return [picture(view, number) for number in numbers]


def write_images(folder: Path, view: int, numbers: range = range(N_FRAMES), first: int = 0) -> None:
    folder.mkdir(parents=True)
    for number in numbers:
        cv2.imwrite(str(folder / f"img_{number + first:04d}.png"), picture(view, number))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three views as videos and as images, with clean plates and the rig."""
    root = tmp_path_factory.mktemp("recorded")
    cameras = []
    for v, name in enumerate(VIEWS):
        place = (4 * np.cos(v), 4 * np.sin(v), 1.5)
        cameras.append(Camera.looking_at(name, (WIDTH, HEIGHT), 60.0, place, np.array([0, 0, 1.0])))
        write_video(root / f"{name}.mp4", pictures_of(v))
        write_images(root / "images" / name, v)
        cv2.imwrite(str(root / f"plate_{name}.png"), picture(v, 0))
    save_rig(Rig(tuple(cameras)), root / "rig.toml")
    return root


@pytest.fixture
def folder(recorded: Path, tmp_path: Path) -> Path:
    """A copy of the recording that a test may spoil."""
    return Path(shutil.copytree(recorded, tmp_path / "copy"))


def videos(folder: Path, **settings: Any) -> VideoReading:
    return VideoReading(path=str(folder / "{view}.mp4"), rig=folder / "rig.toml", **settings)


def images(folder: Path, **settings: Any) -> ImageReading:
    path = str(folder / "images" / "{view}" / "img_{frame}.png")
    return ImageReading(path=path, rig=folder / "rig.toml", fps=float(FPS), **settings)


KINDS: dict[str, Callable[..., Recording]] = {"videos": videos, "images": images}
both = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS.keys())


def shown(recording: Recording) -> list[tuple[tuple[int, int] | None, ...]]:
    """What the images of all frames show."""
    return [tuple(map(seen, frame.images)) for frame in recording.open().frames()]


@both
def test_every_view_of_every_frame(recorded: Path, kind: Callable[..., Recording]) -> None:
    sequence = kind(recorded).open()
    assert isinstance(sequence, reading.Sequence)
    assert isinstance(kind(recorded), reading.Reading)
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
def test_a_sequence_can_be_read_again(recorded: Path, kind: Callable[..., Recording]) -> None:
    sequence = kind(recorded, stop=4).open()
    first = [[seen(image) for image in frame.images] for frame in sequence.frames()]
    assert [[seen(image) for image in frame.images] for frame in sequence.frames()] == first


@both
@pytest.mark.parametrize(("start", "stop", "stride"), [(0, None, 1), (5, 12, 1), (3, None, 4), (19, 20, 7), (0, 1, 1)])
def test_ranges(recorded: Path, kind: Callable[..., Recording], start: int, stop: int | None, stride: int) -> None:
    recording = dataclasses.replace(kind(recorded), start=start, stop=stop, stride=stride)
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
    recorded: Path, kind: Callable[..., Recording], start: int, stop: int | None
) -> None:
    with pytest.raises(SequenceError, match=r"the recording has 20.*start and stop"):
        kind(recorded, start=start, stop=stop).open()


@both
def test_chosen_views_in_the_wanted_order(recorded: Path, kind: Callable[..., Recording]) -> None:
    recording = kind(recorded, views=("west", "east"), stop=2)
    assert recording.open().rig.names == ("west", "east")
    assert shown(recording) == [((2, 0), (0, 0)), ((2, 1), (0, 1))]


@both
def test_an_unknown_view_is_refused(recorded: Path, kind: Callable[..., Recording]) -> None:
    with pytest.raises(CalibrationError, match=r'no camera "nort".*did you mean "north"'):
        kind(recorded, views=("nort",)).open()


@both
def test_offsets_say_which_image_belongs_to_frame_0(folder: Path, kind: Callable[..., Recording]) -> None:
    write_video(folder / "north.mp4", pictures_of(1, range(3, N_FRAMES)))
    shutil.rmtree(folder / "images" / "north")
    write_images(folder / "images" / "north", 1, range(3, N_FRAMES), first=-3)
    recording = kind(folder, offsets={"east": 3, "west": 3})
    assert shown(recording) == [((0, n), (1, n), (2, n)) for n in range(3, N_FRAMES)]
    with pytest.raises(SequenceError, match=r'offsets: no view "wst".*did you mean "west"'):
        kind(folder, offsets={"wst": 3}).open()


@both
def test_views_of_unequal_length(folder: Path, kind: Callable[..., Recording]) -> None:
    write_video(folder / "north.mp4", pictures_of(1, range(14)))
    shutil.rmtree(folder / "images" / "north")
    write_images(folder / "images" / "north", 1, range(14))
    with pytest.raises(SequenceError, match=r"east 20, north 14, west 20.*on_missing"):
        kind(folder).open()
    recording = kind(folder, on_missing="skip")
    frames = list(recording.open().frames())
    assert len(frames) == N_FRAMES
    assert [frame.missing for frame in frames] == [()] * 14 + [(1,)] * 6
    assert shown(recording)[15] == ((0, 15), None, (2, 15))


@both
def test_a_negative_offset_leaves_a_view_out_of_the_first_frames(folder: Path, kind: Callable[..., Recording]) -> None:
    recording = kind(folder, offsets={"west": -2}, on_missing="skip")
    assert shown(recording)[:4] == [
        ((0, 0), (1, 0), None), ((0, 1), (1, 1), None), ((0, 2), (1, 2), (2, 0)), ((0, 3), (1, 3), (2, 1))
    ]  # fmt: skip


@both
def test_images_of_another_size_than_calibrated(folder: Path, kind: Callable[..., Recording]) -> None:
    smaller = load_rig(folder / "rig.toml").downscaled(2)
    save_rig(smaller, folder / "rig.toml")
    for policy in ("error", "skip"):
        with pytest.raises(CalibrationError, match=r"64x48 px, the rig was calibrated at 32x24"):
            list(kind(folder, on_missing=policy).open().frames())


@both
def test_images_turned_against_their_calibration(folder: Path, kind: Callable[..., Recording]) -> None:
    rig = load_rig(folder / "rig.toml")
    save_rig(Rig(tuple(camera.turned(1) for camera in rig.cameras)), folder / "rig.toml")
    with pytest.raises(CalibrationError, match=r"64x48 px, .* 48x64 px: are the images turned upright.*--upright"):
        list(kind(folder).open().frames())


@both
@pytest.mark.parametrize("name", ["rig.qca.txt", "rig.json", "opencv", "easymocap"])
def test_a_rig_in_any_layout_is_read(folder: Path, kind: Callable[..., Recording], name: str) -> None:
    before = load_rig(folder / "rig.toml")
    save_rig(before, folder / name, name if "." not in name else None)
    sequence = dataclasses.replace(kind(folder), rig=folder / name, views=VIEWS[::-1]).open()
    assert sequence.rig.names == VIEWS[::-1]
    np.testing.assert_allclose(sequence.rig.cameras[0].matrix, before.cameras[-1].matrix, atol=1e-9)


@both
@pytest.mark.parametrize("factor", [2, 3])
def test_downscaling_averages_the_images_and_scales_the_rig(
    recorded: Path, kind: Callable[..., Recording], factor: int
) -> None:
    full = kind(recorded, stop=3).open()
    small = kind(recorded, stop=3, downscale=factor, background=str(recorded / "plate_{view}.png")).open()
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
def test_backgrounds(folder: Path, kind: Callable[..., Recording]) -> None:
    pictures = kind(folder, background=str(folder / "plate_{view}.png")).open().plates
    assert [seen(plate and plate.picture) for plate in pictures] == [(0, 0), (1, 0), (2, 0)]
    for v, name in enumerate(VIEWS):
        passing = [*pictures_of(v, range(9, 16)), *[picture(v, 2)] * 33]
        write_video(folder / f"empty_{name}.mp4", passing)
    clips = kind(folder, background=str(folder / "empty_{view}.mp4")).open().plates
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
    folder: Path, kind: Callable[..., Recording], spoil: Callable[[Path], None], reason: str
) -> None:
    spoil(folder / "plate_north.png")
    with pytest.raises(SequenceError, match=reason):
        kind(folder, background=str(folder / "plate_{view}.png")).open()


def test_a_background_of_another_size(folder: Path) -> None:
    cv2.imwrite(str(folder / "plate_north.png"), picture(1, 0)[:40])
    with pytest.raises(CalibrationError, match=r'"north".*64x40'):
        videos(folder, background=str(folder / "plate_{view}.png")).open()


@both
def test_missing_files_are_named(folder: Path, kind: Callable[..., Recording]) -> None:
    (folder / "west.mp4").unlink()
    shutil.rmtree(folder / "images" / "west")
    with pytest.raises(SequenceError, match=r'view "west": no (file|folder) \S*west'):
        kind(folder).open()


@pytest.mark.parametrize("content", [b"these are words" * 100, None])
def test_a_view_that_cannot_be_opened(folder: Path, content: bytes | None) -> None:
    path = folder / "north.mp4"
    path.unlink()
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SequenceError, match=r'view "north": .*north\.mp4'):
        videos(folder).open()
    frames = list(videos(folder, on_missing="skip").open().frames())
    assert len(frames) == N_FRAMES
    assert all(frame.missing == (1,) for frame in frames)


def test_no_view_that_can_be_opened(folder: Path) -> None:
    for path in folder.glob("*.mp4"):
        path.write_bytes(b"these are words" * 100)
    with pytest.raises(SequenceError, match="is not a video"):
        videos(folder, on_missing="skip").open()


def truncate(path: Path, view: int, share: float) -> None:
    """A video cut off while it was copied; its header, at the front, still tells all frames."""
    rng = np.random.default_rng(0)
    noisy = [image + rng.integers(0, 3, image.shape, dtype=np.uint8) for image in pictures_of(view)]
    write_video(path, noisy)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])


def test_a_truncated_video_is_noticed(folder: Path) -> None:
    truncate(folder / "north.mp4", 1, 0.8)
    with pytest.raises(SequenceError, match=r"north"):
        list(videos(folder).open().frames())
    frames = list(videos(folder, on_missing="skip").open().frames())
    assert len(frames) == N_FRAMES
    present = [1 not in frame.missing for frame in frames]
    whole = present.index(False)
    assert 0 < whole < N_FRAMES
    assert not any(present[whole:])
    assert [seen(frame.images[1]) for frame in frames[:whole]] == [(1, number) for number in range(whole)]
    assert all(seen(frame.images[0]) == (0, number) for number, frame in enumerate(frames))


def test_a_frame_that_cannot_be_decoded_is_named(folder: Path) -> None:
    path = folder / "north.mp4"
    with av.open(str(path)) as container:
        packets = [packet for packet in container.demux(video=0) if packet.size]
        broken = max(packets[6:11], key=lambda packet: packet.size)
        start, size = broken.pos or 0, broken.size
    content = bytearray(path.read_bytes())
    content[start : start + size] = b"\x55" * size
    path.write_bytes(content)
    with pytest.raises(SequenceError, match=r"north\.mp4: frame \d+ cannot be decoded: .*corrupt.*on_missing"):
        list(videos(folder).open().frames())
    found = [views[1] for views in shown(videos(folder, on_missing="skip"))]
    whole_again = next(packet for packet in packets[packets.index(broken) :] if packet.is_keyframe)
    key = sorted(packet.pts for packet in packets).index(whole_again.pts)
    assert 0 < found.count(None) < 9
    assert all(one in (None, (1, k)) for k, one in enumerate(found))
    assert None not in found[key:]


def test_a_header_that_tells_more_frames_than_there_are(folder: Path) -> None:
    """All views cut off alike have equal lengths; only the headers tell."""
    for v, name in enumerate(VIEWS):
        truncate(folder / f"{name}.mp4", v, 0.8)
    with pytest.raises(SequenceError, match=r'view "east": \S*east\.mp4 holds \d+ of the 20 frames.*truncated'):
        videos(folder).open()


def test_lost_frames_do_not_shift_the_later_ones(folder: Path) -> None:
    """Matroska files lose whole frames where they are spoilt; the time stamps tell which."""
    for v, name in enumerate(VIEWS):
        write_video(folder / f"{name}.mkv", pictures_of(v), gop=1)
    lost = 7
    with av.open(str(folder / "north.mkv")) as source, av.open(str(folder / "gap.mkv"), "w") as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        packets = [packet for packet in source.demux(video=0) if packet.size]
        for packet in packets[:lost] + packets[lost + 1 :]:
            packet.stream = stream
            target.mux(packet)
    (folder / "gap.mkv").replace(folder / "north.mkv")
    recording = dataclasses.replace(videos(folder), path=str(folder / "{view}.mkv"), stop=N_FRAMES - 1)
    with pytest.raises(SequenceError, match=rf'view "north" has no image for frame {lost}; set on_missing'):
        list(recording.open().frames())
    expected = [(1, number) if number != lost else None for number in range(N_FRAMES - 1)]
    assert [views[1] for views in shown(dataclasses.replace(recording, on_missing="skip"))] == expected


def written_at(path: Path, times_ms: list[int], pictures: list[Image]) -> None:
    """A video whose images lie at other times than at an even pace."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=FPS, options={"bf": "0"})
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt, stream.codec_context.time_base = "yuv420p", Fraction(1, 1000)
        for time_ms, image in zip(times_ms, pictures, strict=True):
            frame = av.VideoFrame.from_ndarray(image, format="bgr24")
            frame.pts, frame.time_base = time_ms, Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def test_dropped_frames_are_missing_and_the_others_stay_at_their_times(folder: Path) -> None:
    """A camera that drops frames writes the time stamps of the others; the pace is theirs."""
    kept = [k for k in range(N_FRAMES) if k not in (3, 4, 11)]
    written_at(folder / "north.mp4", [round(1000 * k / FPS) for k in kept], [picture(1, k) for k in kept])
    opened = videos(folder, on_missing="skip").open()
    assert opened.fps == FPS
    found = [seen(frame.images[1]) for frame in opened.frames()]
    assert found == [(1, k) if k in kept else None for k in range(N_FRAMES)]


def test_a_frame_rate_that_varies_is_resampled_by_time_and_that_is_said(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rng, at = np.random.default_rng(2), [0]
    for _ in range(N_FRAMES - 1):
        at.append(at[-1] + int(rng.choice([20, 40, 47, 61])))
    written_at(folder / "north.mp4", at, pictures_of(1))
    recording = dataclasses.replace(videos(folder), views=("north",))
    opened = recording.open()
    interval_ms = 1000 / opened.fps
    assert "frame rate varies (20 to 61 ms): resampled to" in caplog.text
    for k, frame in enumerate(opened.frames()):
        found = seen(frame.images[0])
        assert found is not None
        assert abs(at[found[1]] - k * interval_ms) == min(abs(time_ms - k * interval_ms) for time_ms in at)


def test_container_stamps_of_whole_milliseconds_are_an_even_pace() -> None:
    for fps in (29.97, 59.94, 119.88, 24):
        stamps: list[int | None] = [round(1000 * k / fps) for k in range(3000)]
        found = timeline_of(stamps, 0.001, fps)
        assert (found.stamps, found.remark) == (tuple(stamps), "")
        assert found.fps == pytest.approx(fps, rel=1e-4)


def test_without_time_stamps_images_are_frames() -> None:
    assert timeline_of([None, 4, 5], 0.001, 25.0).stamps == (0, 1, 2)
    assert timeline_of([7], 0.001, 25.0).stamps == (0,)
    assert timeline_of([5, 5, 6], 0.001, 25.0).stamps == (0, 1, 2)


TURNS = {90: (0, 1, -1, 0), 180: (-1, 0, 0, -1), 270: (0, -1, 1, 0)}
"""Clockwise degrees -> the upper left of the display matrix."""


@pytest.mark.parametrize("turn", TURNS)
def test_videos_are_turned_as_their_metadata_tell(turn: int, tmp_path: Path) -> None:
    """As OpenCV, which most calibrations are made with, and players do."""
    path = tmp_path / "phone.mp4"
    image = picture(1, 3)
    image[:20, :30] = (0, 0, 255)
    write_video(path, 3 * [image])
    content, unit = path.read_bytes(), 0x10000
    upright = struct.pack(">9i", unit, 0, 0, 0, unit, 0, 0, 0, 0x40000000)
    a, b, c, d = (unit * entry for entry in TURNS[turn])
    turned = struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 0x40000000)
    header = content.index(b"tkhd")
    place = content.index(upright, header)
    path.write_bytes(content[:place] + turned + content[place + 36 :])
    found = open_clip(path, "phone")[2].read(0)
    oracle = cv2.VideoCapture(str(path)).read()[1]
    assert found is not None
    assert found.shape == oracle.shape
    assert np.abs(found.astype(int) - oracle).max() <= 12  # two conversions of colours
    np.testing.assert_allclose(found, np.rot90(open_clip(upright_copy(path, content), "x")[2].read(0), -turn // 90))


def upright_copy(path: Path, content: bytes) -> Path:
    copy = path.with_name("upright.mp4")
    copy.write_bytes(content)
    return copy


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


def test_stop_within_the_shortest_view_needs_nothing_more(folder: Path) -> None:
    write_video(folder / "north.mp4", pictures_of(1, range(14)))
    assert len(shown(videos(folder, stop=14))) == 14
    with pytest.raises(SequenceError, match=r"north 14"):
        videos(folder, stop=15).open()


@both
def test_a_path_without_view_is_refused(recorded: Path, kind: Callable[..., Recording]) -> None:
    recording = kind(recorded)
    fixed = dataclasses.replace(recording, path=recording.path.replace("{view}", "east"))
    with pytest.raises(SequenceError, match=r"no \{view\} in it, so all 3 views would show the same"):
        fixed.open()
    assert shown(dataclasses.replace(fixed, views=("east",), stop=1)) == [((0, 0),)]
    with pytest.raises(SequenceError, match=r"no \{view\} in it"):
        kind(recorded, background=str(recorded / "plate_east.png")).open()


def test_different_frame_rates_are_refused(folder: Path) -> None:
    write_video(folder / "north.mp4", pictures_of(1), fps=30)
    with pytest.raises(SequenceError, match=r"east 25\.00, north 30\.00, west 25\.00 fps"):
        videos(folder).open()
    assert videos(folder, fps=50.0).open().fps == 50.0
    assert next(videos(folder, fps=50.0, start=10).open().frames()).time_s == pytest.approx(0.2)


def test_image_numbers_need_not_start_at_0(folder: Path) -> None:
    for v, name in enumerate(VIEWS):
        shutil.rmtree(folder / "images" / name)
        write_images(folder / "images" / name, v, first=997)
    assert shown(images(folder, start=8, stop=10)) == [tuple((v, n) for v in range(3)) for n in (8, 9)]


def test_a_view_that_lacks_its_first_images_is_not_shifted(folder: Path) -> None:
    (folder / "images" / "north" / "img_0000.png").unlink()
    with pytest.raises(SequenceError, match=r'view "north" has no image for frame 0'):
        list(images(folder).open().frames())
    assert shown(images(folder, on_missing="skip"))[:2] == [((0, 0), None, (2, 0)), ((0, 1), (1, 1), (2, 1))]


def test_a_jpeg_cut_off_is_noticed(folder: Path) -> None:
    """OpenCV would fill the rest with grey."""
    for v, name in enumerate(VIEWS):
        for number in range(3):
            cv2.imwrite(str(folder / "images" / name / f"img_{number}.jpg"), picture(v, number))
    recording = dataclasses.replace(images(folder), path=str(folder / "images" / "{view}" / "img_{frame}.jpg"))
    assert len(shown(recording)) == 3
    spoilt = folder / "images" / "west" / "img_1.jpg"
    spoilt.write_bytes(spoilt.read_bytes()[:-40])
    with pytest.raises(SequenceError, match=r"west/img_1\.jpg: not an image that can be read"):
        shown(recording)
    assert [views[2] for views in shown(dataclasses.replace(recording, on_missing="skip"))] == [(2, 0), None, (2, 2)]


def test_images_are_sorted_by_number_not_by_letter(folder: Path) -> None:
    for name in VIEWS:
        for file in (folder / "images" / name).iterdir():
            number = int(re.sub(r"\D", "", file.name))
            file.rename(file.with_name(f"img_{number}.png"))
    assert [views[2] for views in shown(images(folder))] == [(2, number) for number in range(N_FRAMES)]


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda path: path.unlink(), r'view "north" has no image for frame 7'),
        (lambda path: path.write_bytes(path.read_bytes()[:80]), r"img_0007\.png: not an image that can be read"),
    ],
    ids=["missing", "truncated"],
)
def test_one_bad_image(folder: Path, spoil: Callable[[Path], None], reason: str) -> None:
    spoil(folder / "images" / "north" / "img_0007.png")
    with pytest.raises(SequenceError, match=reason):
        list(images(folder).open().frames())
    frames = list(images(folder, on_missing="skip").open().frames())
    assert [frame.index for frame in frames if frame.missing] == [7]
    assert frames[7].missing == (1,)
    assert seen(frames[8].images[1]) == (1, 8)


def test_image_patterns_that_cannot_work(folder: Path) -> None:
    with pytest.raises(SequenceError, match=r"no \{frame\}"):
        dataclasses.replace(images(folder), path=str(folder / "images" / "{view}" / "img.png")).open()
    with pytest.raises(SequenceError, match=r"no \{frame\} in the file name"):
        dataclasses.replace(images(folder), path=str(folder / "images" / "{view}_{frame}" / "img.png")).open()
    with pytest.raises(SequenceError, match=r'view "east": no image picture_\{frame\}\.png'):
        dataclasses.replace(images(folder), path=str(folder / "images" / "{view}" / "picture_{frame}.png")).open()


def test_frames_are_streamed(recorded: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No view is decoded further ahead than the frame after the one in hand."""
    lock, decoded = threading.Lock(), dict.fromkeys(VIEWS, 0)
    original = VideoView.read

    def counted(self: VideoView, index: int) -> Image | None:
        with lock:
            decoded[self._path.stem] = max(decoded[self._path.stem], index + 1)
        return original(self, index)

    monkeypatch.setattr(VideoView, "read", counted)
    frames = videos(recorded).open().frames()
    assert max(decoded.values()) == 0
    for _ in range(5):
        frame = next(frames)
        assert max(decoded.values()) <= frame.index + 2
    frames.close()  # type: ignore[attr-defined]
    assert max(decoded.values()) < N_FRAMES


def test_abandoned_frames_leave_no_thread(recorded: Path) -> None:
    before = threading.active_count()
    frames = videos(recorded).open().frames()
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


def write_masks(folder: Path, numbers: range = range(N_FRAMES), first: int = 0) -> None:
    """A square that moves a pixel a frame; the label of the person is not always 255."""
    for v, name in enumerate(VIEWS):
        (folder / name).mkdir(parents=True)
        for number in numbers:
            mask = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
            mask[10:20, 10 + number : 20 + number] = 1 + v
            cv2.imwrite(str(folder / name / f"{number + first:03d}.png"), mask)


def test_masks_come_with_their_frames(recorded: Path, tmp_path: Path) -> None:
    write_masks(tmp_path / "masks")
    masks = str(tmp_path / "masks" / "{view}" / "{frame}.png")
    reading = videos(recorded, masks=masks, start=3, stop=6, offsets={"north": 2})
    for frame in reading.open().frames():
        for v, shift in enumerate((0, 2, 0)):
            mask = frame.mask(v)
            assert mask is not None
            assert mask.sum() == 100
            assert mask[10:20, 10 + frame.index + shift : 20 + frame.index + shift].all()
    small = next(dataclasses.replace(reading, downscale=2).open().frames()).mask(0)
    assert small is not None
    assert small.shape == (HEIGHT // 2, WIDTH // 2)
    assert abs(int(small.sum()) - 25) <= 5
    assert next(videos(recorded).open().frames()).masks == ()
    assert [one is not None for one in reading.open().known] == [True] * 3
    assert videos(recorded).open().known == (None,) * 3


def test_masks_of_images_are_numbered_as_they_are(tmp_path: Path, recorded: Path) -> None:
    for v, name in enumerate(VIEWS):
        write_images(tmp_path / "images" / name, v, first=17)
    write_masks(tmp_path / "masks", first=17)
    path, masks = str(tmp_path / "images" / "{view}" / "img_{frame}.png"), str(tmp_path / "masks/{view}/{frame}.png")
    frame = next(ImageReading(path=path, rig=recorded / "rig.toml", fps=25.0, masks=masks, start=4).open().frames())
    mask = frame.mask(1)
    assert mask is not None
    assert mask[10:20, 14:24].all()


def test_masks_that_are_missing_or_wrong_are_named(recorded: Path, tmp_path: Path) -> None:
    write_masks(tmp_path / "masks")
    (tmp_path / "masks" / "north" / "007.png").unlink()
    reading = videos(recorded, masks=str(tmp_path / "masks" / "{view}" / "{frame}.png"))
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
