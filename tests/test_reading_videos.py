"""Reading videos: time stamps, lost frames, headers that tell wrong numbers, turned pictures."""

from __future__ import annotations

import dataclasses
import re
import struct
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from numbered_pictures import (
    FPS,
    N_FRAMES,
    VIEWS,
    picture,
    pictures_of,
    seen,
    shown,
    videos,
    write_video,
)

from tracker.foundation.arrays import Image
from tracker.foundation.errors import SequenceError
from tracker.images.reading._stamps import _apart
from tracker.images.reading._timeline import Timeline, at_one_pace, timeline_of
from tracker.images.reading.video import open_clip


def truncate(path: Path, view: int, share: float) -> None:
    """A video cut off while it was copied; its header, at the front, still tells all frames."""
    rng = np.random.default_rng(0)
    noisy = [image + rng.integers(0, 3, image.shape, dtype=np.uint8) for image in pictures_of(view)]
    write_video(path, noisy)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])


def test_a_truncated_video_is_noticed(copied: Path) -> None:
    truncate(copied / "north.mp4", 1, 0.8)
    with pytest.raises(SequenceError, match=r"north"):
        list(videos(copied).open().frames())
    frames = list(videos(copied, on_missing="skip").open().frames())
    assert len(frames) == N_FRAMES
    present = [1 not in frame.missing for frame in frames]
    whole = present.index(False)
    assert 0 < whole < N_FRAMES
    assert not any(present[whole:])
    assert [seen(frame.images[1]) for frame in frames[:whole]] == [(1, number) for number in range(whole)]
    assert all(seen(frame.images[0]) == (0, number) for number, frame in enumerate(frames))


def test_a_frame_that_cannot_be_decoded_is_named(copied: Path) -> None:
    path = copied / "north.mp4"
    with av.open(str(path)) as container:
        packets = [packet for packet in container.demux(video=0) if packet.size]
        broken = max(packets[6:11], key=lambda packet: packet.size)
        start, size = broken.pos or 0, broken.size
    content = bytearray(path.read_bytes())
    content[start : start + size] = b"\x55" * size
    path.write_bytes(content)
    with pytest.raises(SequenceError, match=r"north\.mp4: frame \d+ cannot be decoded: .*corrupt.*on_missing"):
        list(videos(copied).open().frames())
    found = [views[1] for views in shown(videos(copied, on_missing="skip"))]
    whole_again = next(packet for packet in packets[packets.index(broken) :] if packet.is_keyframe)
    key = sorted(packet.pts for packet in packets).index(whole_again.pts)
    assert 0 < found.count(None) < 9
    assert all(one in (None, (1, k)) for k, one in enumerate(found))
    assert None not in found[key:]


def test_a_header_that_tells_more_frames_than_there_are(copied: Path) -> None:
    """All views cut off alike have equal lengths; only the headers tell."""
    for v, name in enumerate(VIEWS):
        truncate(copied / f"{name}.mp4", v, 0.8)
    with pytest.raises(SequenceError, match=r'view "east": \S*east\.mp4 holds \d+ of the 20 frames.*truncated'):
        videos(copied).open()


def test_lost_frames_do_not_shift_the_later_ones(copied: Path) -> None:
    """Matroska files lose whole frames where they are spoilt; the time stamps tell which."""
    for v, name in enumerate(VIEWS):
        write_video(copied / f"{name}.mkv", pictures_of(v), gop=1)
    lost = 7
    with av.open(str(copied / "north.mkv")) as source, av.open(str(copied / "gap.mkv"), "w") as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        packets = [packet for packet in source.demux(video=0) if packet.size]
        for packet in packets[:lost] + packets[lost + 1 :]:
            packet.stream = stream
            target.mux(packet)
    (copied / "gap.mkv").replace(copied / "north.mkv")
    recording = dataclasses.replace(videos(copied), path=str(copied / "{view}.mkv"), stop=N_FRAMES - 1)
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


def test_dropped_frames_are_missing_and_the_others_stay_at_their_times(copied: Path) -> None:
    """A camera that drops frames writes the time stamps of the others; the pace is theirs."""
    kept = [k for k in range(N_FRAMES) if k not in (3, 4, 11)]
    written_at(copied / "north.mp4", [round(1000 * k / FPS) for k in kept], [picture(1, k) for k in kept])
    opened = videos(copied, on_missing="skip").open()
    assert opened.fps == FPS
    found = [seen(frame.images[1]) for frame in opened.frames()]
    assert found == [(1, k) if k in kept else None for k in range(N_FRAMES)]


def test_dropped_frames_of_an_avi_are_missing_too(copied: Path) -> None:
    """It has no time stamps, but an empty place for each."""
    kept = [k for k in range(N_FRAMES) if k not in (3, 4, 11)]
    for codec in ("mjpeg", "libx264"):
        with av.open(str(copied / "north.avi"), "w") as container:
            stream = container.add_stream(codec, rate=FPS, options={"bf": "0"})
            stream.height, stream.width = picture(1, 0).shape[:2]
            stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
            for k in kept:
                frame = av.VideoFrame.from_ndarray(picture(1, k), format="bgr24")
                frame.pts, frame.time_base = k, Fraction(1, FPS)
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
        n_frames, fps, view = open_clip(copied / "north.avi", "north")
        assert (n_frames, fps) == (N_FRAMES, FPS)
        assert [seen(view.read(k)) for k in range(n_frames)] == [(1, k) if k in kept else None for k in range(N_FRAMES)]


def test_masks_and_keypoints_of_a_video_with_dropped_frames_are_those_of_its_images(copied: Path) -> None:
    """Whoever decodes the file counts the images that it has: behind a gap masks were those of a later image."""
    kept = [k for k in range(N_FRAMES) if k not in (3, 4, 11)]
    written_at(copied / "north.mp4", [round(1000 * k / FPS) for k in kept], [picture(1, k) for k in kept])
    for name in VIEWS:
        (copied / "masks" / name).mkdir(parents=True)
        for number, shown_frame in enumerate(kept if name == "north" else range(N_FRAMES)):
            mask = np.zeros(picture(1, 0).shape[:2], dtype=np.uint8)
            mask[0, shown_frame] = 1
            cv2.imwrite(str(copied / "masks" / name / f"{number}.png"), mask)
    recording = videos(copied, on_missing="skip", masks=str(copied / "masks" / "{view}" / "{frame}.png"))
    for frame in recording.open().frames():
        found = frame.mask(1)
        assert (found is None) == (frame.index not in kept)
        assert found is None or found[0, frame.index]
        assert frame.position(0) == frame.index
        assert frame.position(1) == (kept.index(frame.index) if frame.index in kept else -1)
    for number in range(len(kept), N_FRAMES):
        cv2.imwrite(str(copied / "masks" / "north" / f"{number}.png"), mask)
    with pytest.raises(SequenceError, match=r'view "north": numbered up to 19, the video holds 17 images'):
        recording.open()


def test_a_video_trimmed_without_encoding_it_anew_is_whole(copied: Path) -> None:
    """An edit list says from where on it is shown; what is before it is still in the file, and in its header."""
    path = copied / "north.mp4"
    written_at(path, [round(1000 * (k - 5) / FPS) for k in range(N_FRAMES)], pictures_of(1))
    with av.open(str(path)) as container:
        assert container.streams.video[0].frames == N_FRAMES
    n_frames, _, view = open_clip(path, "north")
    oracle = cv2.VideoCapture(str(path)).read()[1]
    assert n_frames == N_FRAMES - 5
    assert [seen(view.read(k)) for k in range(n_frames)] == [(1, k) for k in range(5, N_FRAMES)]
    assert seen(np.asarray(oracle, dtype=np.uint8)) == (1, 5)


def test_views_whose_frame_rates_vary_stay_together() -> None:
    """What they are resampled to is one pace for all: by their usual intervals they were 0.4 s apart after 100 s."""
    stamps = []
    for usual, seed in ((2997, 1), (3009, 2)):
        rng = np.random.default_rng(seed)
        steps = np.where(rng.random(3000) < 0.8, usual, usual * rng.choice([0.5, 1.4, 1.6], 3000))
        stamps.append([0, *np.cumsum(np.round(steps)).astype(int).tolist()])
    one, other, absent = at_one_pace([*(timeline_of(list(own), 1 / 90000, 30.0) for own in stamps), None])
    assert one is not None
    assert other is not None
    assert absent is None
    assert one.fps == other.fps
    shown_at = [np.array(view.stamps[:2900], dtype=float) / 90000 for view in (one, other)]
    assert np.abs(shown_at[0] - shown_at[1]).max() < 1.7 / 30
    even = timeline_of([3000 * k for k in range(3000)], 1 / 90000, 30.0)
    again, unchanged = at_one_pace([one, even])
    assert again is not None
    assert again.fps == 30.0
    assert unchanged is even


def test_a_frame_rate_that_varies_is_resampled_by_time_and_that_is_said(
    copied: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rng, at = np.random.default_rng(2), [0]
    for _ in range(N_FRAMES - 1):
        at.append(at[-1] + int(rng.choice([20, 40, 47, 61])))
    written_at(copied / "north.mp4", at, pictures_of(1))
    recording = dataclasses.replace(videos(copied), views=("north",))
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


def test_different_frame_rates_are_refused(copied: Path) -> None:
    write_video(copied / "north.mp4", pictures_of(1), fps=30)
    with pytest.raises(SequenceError, match=r"east 25\.00, north 30\.00, west 25\.00 fps"):
        videos(copied).open()
    write_video(copied / "north.mp4", pictures_of(1))
    assert videos(copied, fps=50.0).open().fps == 50.0
    assert next(videos(copied, fps=50.0, start=10).open().frames()).time_s == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("n_frames", "words"), [(200, ""), (2000, r"paired by number: at the end they are 2\.0 frames")]
)
def test_views_that_drift_apart_slowly_are_told_of(n_frames: int, words: str) -> None:
    """29.97 and 30 frames a second are one frame apart every 33 s."""
    even = Timeline(30.0, tuple(range(n_frames)))
    told = _apart([even, dataclasses.replace(even, fps=29.97)])
    assert re.search(words, told) if words else not told
    assert not _apart([even, even])
