"""What files tell of their clock, of their films and of their pictures: asked for, made use of, or told."""

from __future__ import annotations

import dataclasses
import logging
import shutil
import struct
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from av.stream import Disposition
from numbered_pictures import FPS, N_FRAMES, VIEWS, picture, pictures_of, seen, shown, videos, write_images, write_video

from tracker.foundation.arrays import Image
from tracker.foundation.errors import SequenceError
from tracker.images.footage import header
from tracker.images.reading.images import ImageReading
from tracker.images.reading.video import VideoReading, open_clip

RAW = {
    "h264": ("h264", "libx264", 90),
    "h265": ("hevc", "libx265", 60),
    "m4v": ("m4v", "mpeg4", 60),
    "m2v": ("mpeg2video", "mpeg2video", 60),
    "mjpeg": ("mjpeg", "mjpeg", 60),
}
"""Ending -> FFmpeg's name of the form without a container, the codec and the true frames a second."""

HINTED = {"h264": 90, "h265": 60, "m4v": 60, "m2v": 60}


def write(path: Path, pictures: list[Image], **settings: Any) -> Path:
    """A film in a form, of a codec, with the settings of its stream."""
    form, codec, fps = settings.pop("form", None), settings.pop("codec", "libx264"), settings.pop("fps", FPS)
    options, metadata = settings.pop("options", {}), settings.pop("metadata", {})
    container_options = settings.pop("container_options", {})
    pix_fmt = settings.pop("pix_fmt", "yuvj420p" if codec == "mjpeg" else "yuv420p")
    own = settings.pop("of_stream", {})
    with av.open(str(path), "w", format=form, options=container_options) as container:
        container.metadata.update(metadata)
        stream = container.add_stream(codec, rate=fps, options=options)
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt = pix_fmt
        for name, value in settings.items():
            setattr(stream.codec_context, name, value)
        stream.metadata.update(own)
        for image in pictures:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        container.mux(stream.encode())
    return path


def raw(folder: Path, ending: str) -> VideoReading:
    form, codec, fps = RAW[ending]
    for v, name in enumerate(VIEWS):
        write(folder / f"{name}.{ending}", pictures_of(v), form=form, codec=codec, fps=fps, options={"b": "2M"})
    return VideoReading(path=str(folder / f"{{view}}.{ending}"), rig=folder / "rig.toml")


@pytest.mark.parametrize("ending", RAW)
def test_a_stream_without_a_clock_is_asked_for_its_rate(ending: str, copied: Path) -> None:
    """25 frames a second were taken without a word, which is what FFmpeg makes of no clock."""
    recording = raw(copied, ending)
    with pytest.raises(SequenceError, match=r"east, north, west are streams without a container.*set fps") as told:
        recording.open()
    hint = f"fps = {HINTED[ending]}," if ending in HINTED else "nor do the images hint"
    assert hint in str(told.value)
    given = dataclasses.replace(recording, fps=float(RAW[ending][2]))
    assert given.open().fps == RAW[ending][2]
    assert shown(given) == [tuple((v, k) for v in range(3)) for k in range(N_FRAMES)]


def test_a_stream_that_is_called_a_container_has_no_clock_either(copied: Path) -> None:
    recording = raw(copied, "h264")
    for name in VIEWS:
        shutil.move(copied / f"{name}.h264", copied / f"{name}.mp4")
    with pytest.raises(SequenceError, match="streams without a container"):
        dataclasses.replace(recording, path=str(copied / "{view}.mp4")).open()


def test_pictures_joined_to_a_stream_have_no_clock(tmp_path: Path) -> None:
    encoded = (cv2.imencode(".png", image)[1].tobytes() for image in pictures_of(0))
    (tmp_path / "east.png").write_bytes(b"".join(encoded))
    recording = VideoReading(path=str(tmp_path / "{view}.png"), views=("east",))
    with pytest.raises(SequenceError, match="no clock: set fps"):
        recording.open_uncalibrated()
    assert dataclasses.replace(recording, fps=60.0).open_uncalibrated().n_frames == N_FRAMES


def test_a_rate_that_is_not_the_one_hinted_at_is_told(copied: Path, caplog: pytest.LogCaptureFixture) -> None:
    dataclasses.replace(raw(copied, "h264"), fps=30.0).open()
    assert 'view "north": the coded images hint at 90 frames a second, fps = 30 is taken' in caplog.text


def test_a_raw_stream_beside_files_of_another_rate_is_refused(copied: Path) -> None:
    write(copied / "raw.h264", pictures_of(1), form="h264", fps=50)
    (copied / "raw.h264").replace(copied / "north.mp4")
    with pytest.raises(SequenceError, match=r"north 50\.00.*write the files anew"):
        videos(copied, fps=50.0).open()
    assert videos(copied, fps=25.0).open().fps == 25.0


@pytest.fixture
def half(copied: Path) -> Path:
    """A recording of which one view has filmed at half the rate."""
    write_video(copied / "north.mp4", pictures_of(1)[::2], fps=Fraction(FPS, 2))  # type: ignore[arg-type]
    return copied


def test_no_rate_makes_views_of_different_rates_fit(half: Path) -> None:
    """They are paired by number: one view ran at double speed, a wrist was 65 mm off and nothing was said."""
    way_out = r"north 12\.50.*not of one moment.*fps = 12\.5 takes every second frame of east, west"
    for settings in ({}, {"fps": 25.0}, {"fps": 25.0, "stop": 10}, {"fps": 50.0, "stop": 10}):
        with pytest.raises(SequenceError, match=way_out):
            videos(half, **settings).open()  # type: ignore[arg-type]


def test_the_lowest_rate_takes_every_second_frame_of_the_others(half: Path) -> None:
    recording = videos(half, fps=12.5)
    assert recording.open().fps == 12.5
    assert shown(recording) == [((0, k), (1, k), (2, k)) for k in range(0, N_FRAMES, 2)]
    frames = list(recording.open().frames())
    assert [frame.time_s for frame in frames] == pytest.approx([k / 12.5 for k in range(10)])
    assert [frame.position(0) for frame in frames] == list(range(0, N_FRAMES, 2)), "as masks and keypoints count"
    assert [frame.position(1) for frame in frames] == list(range(10))
    later = videos(half, fps=12.5, offsets={"east": 1}, stop=9)
    assert shown(later) == [((0, 2 * k + 2), (1, 2 * k), (2, 2 * k)) for k in range(9)]


def test_rates_without_a_common_measure_are_refused(half: Path) -> None:
    write_video(half / "west.mp4", pictures_of(2), fps=30)
    for settings in ({}, {"fps": 12.5}):
        with pytest.raises(SequenceError, match=r"west 30\.00 fps.*: write the files anew at one rate"):
            videos(half, **settings).open()  # type: ignore[arg-type]


def test_a_rate_that_is_not_the_files_is_told(copied: Path, caplog: pytest.LogCaptureFixture) -> None:
    videos(copied, fps=100.0).open()
    assert "the files tell 25 frames a second, fps = 100 is taken" in caplog.text
    caplog.clear()
    videos(copied, fps=25.0).open()
    assert not caplog.text


def test_a_view_of_half_as_many_frames_may_have_half_the_rate(copied: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Also where its header tells the rate of the others, and of images, which tell none."""
    write_video(copied / "north.mp4", pictures_of(1)[::2])
    word = "north has 1 frame for 2 of east: if it filmed as long, at a lower rate"
    with pytest.raises(SequenceError, match=word):
        videos(copied).open()
    videos(copied, stop=10).open()
    assert word in caplog.text
    caplog.clear()
    write_video(copied / "north.mp4", pictures_of(1)[:14])
    videos(copied, stop=10).open()
    assert not caplog.text
    shutil.rmtree(copied / "images" / "north")
    write_images(copied / "images" / "north", 1, range(10))
    path = str(copied / "images" / "{view}" / "img_{frame}.png")
    ImageReading(path=path, rig=copied / "rig.toml", fps=25.0, stop=10).open()
    assert word in caplog.text


def write_films(path: Path, *films: list[Image]) -> None:
    """Several films in one file."""
    with av.open(str(path), "w") as container:
        streams = []
        for pictures in films:
            stream = container.add_stream("libx264", rate=FPS)
            stream.height, stream.width = pictures[0].shape[:2]
            stream.pix_fmt = "yuv420p"
            streams.append(stream)
        for k in range(N_FRAMES):
            for stream, pictures in zip(streams, films, strict=True):
                container.mux(stream.encode(av.VideoFrame.from_ndarray(pictures[k], format="bgr24")))
        for stream in streams:
            container.mux(stream.encode())


def small(view: int, factor: float) -> list[Image]:
    return [np.asarray(cv2.resize(image, None, fx=factor, fy=factor)) for image in pictures_of(view)]


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_of_several_films_the_one_of_the_calibrated_size_is_read(
    factor: float, copied: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The first one was, if it was a preview."""
    write_films(copied / "north.mp4", small(0, factor), pictures_of(1))
    assert [views[1] for views in shown(videos(copied))] == [(1, k) for k in range(N_FRAMES)]
    assert "it holds 2 films" in caplog.text
    assert "64x48 is read, the one of the calibrated size" in caplog.text


def test_without_a_calibration_the_largest_film_is_read(copied: Path, caplog: pytest.LogCaptureFixture) -> None:
    write_films(copied / "north.mp4", small(0, 0.5), pictures_of(1))
    opened = VideoReading(path=str(copied / "{view}.mp4"), views=("north",)).open_uncalibrated()
    assert [seen(frame.images[0]) for frame in opened.frames()] == [(1, k) for k in range(N_FRAMES)]
    assert "64x48 is read, the largest one" in caplog.text


def test_of_films_of_one_size_the_first_is_read_with_a_word(copied: Path, caplog: pytest.LogCaptureFixture) -> None:
    write_films(copied / "north.mp4", pictures_of(1), pictures_of(2))
    assert [views[1] for views in shown(videos(copied))] == [(1, k) for k in range(N_FRAMES)]
    assert "the first one of that size" in caplog.text


def test_a_cover_is_no_film(copied: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = copied / "cover.mp4"
    with av.open(str(copied / "north.mp4")) as source, av.open(str(path), "w") as target:
        cover = target.add_stream("mjpeg", rate=FPS)
        cover.width, cover.height, cover.pix_fmt = 64, 48, "yuvj420p"
        cover.disposition = Disposition.attached_pic
        film = target.add_stream_from_template(source.streams.video[0])
        target.mux(cover.encode(av.VideoFrame.from_ndarray(picture(0, 5), format="bgr24")))
        for packet in source.demux(video=0):
            if packet.size:
                packet.stream = film
                target.mux(packet)
    with av.open(str(path)) as container:
        assert len(container.streams.video) == 2, "else this shows nothing"
    path.replace(copied / "north.mp4")
    assert [views[1] for views in shown(videos(copied))] == [(1, k) for k in range(N_FRAMES)]
    assert "films" not in caplog.text


def of_unknown_codec(path: Path) -> None:
    """A file's last film in a form that FFmpeg knows, by a codec that it does not."""
    before, _, behind = path.read_bytes().rpartition(b"avc1")
    path.write_bytes(before + b"none" + behind)


def test_a_film_of_an_unknown_codec_is_said(copied: Path) -> None:
    """It has no size to ask for."""
    of_unknown_codec(copied / "north.mp4")
    with pytest.raises(SequenceError, match=r"north.mp4 has a film of a codec that FFmpeg does not know"):
        videos(copied).open()


def test_beside_one_of_an_unknown_codec_another_film_is_read(copied: Path) -> None:
    write_films(copied / "north.mp4", pictures_of(1), small(0, 2.0))
    of_unknown_codec(copied / "north.mp4")
    assert [views[1] for views in shown(videos(copied))] == [(1, k) for k in range(N_FRAMES)]


def remarks(path: Path, caplog: pytest.LogCaptureFixture) -> str:
    """What is said of one view when it is opened."""
    caplog.clear()
    with caplog.at_level(logging.WARNING, logger="tracker"):
        VideoReading(path=str(path.with_name("{view}" + path.suffix)), views=(path.stem,)).open_uncalibrated()
    return caplog.text


PICTURES = {
    "pixels that are no squares": ("mp4", {"sample_aspect_ratio": Fraction(16, 11)}, "1.455 times as wide as high"),
    "interlaced": ("mp4", {"options": {"x264-params": "interlaced=1"}}, "it is interlaced"),
    "stereo": ("mkv", {"of_stream": {"stereo_mode": "left_right"}}, "it is a stereo film"),
    "HDR": ("mp4", {"codec": "libx265", "pix_fmt": "yuv420p10le", "color_trc": 18}, "colours are HDR (HLG)"),
    "slow motion": (
        "mp4",
        {"metadata": {"com.android.capture.fps": "240.0"}, "container_options": {"movflags": "use_metadata_tags"}},
        "filmed at 240 frames a second, as its metadata tell, and its time stamps tell 25",
    ),
}


@pytest.mark.parametrize("what", PICTURES)
def test_what_a_file_tells_of_its_pictures_is_told(what: str, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    ending, settings, words = PICTURES[what]
    assert words in remarks(write(tmp_path / f"view.{ending}", pictures_of(1), **dict(settings)), caplog)


def test_usual_files_are_told_nothing_of(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    plain = {"metadata": {"com.android.capture.fps": "25.5"}, "container_options": {"movflags": "use_metadata_tags"}}
    assert not remarks(write(tmp_path / "view.mp4", pictures_of(1), **plain), caplog)
    assert not remarks(write(tmp_path / "view.mkv", pictures_of(1)), caplog)
    assert not remarks(write(tmp_path / "view.gif", pictures_of(1), codec="gif", pix_fmt="rgb8"), caplog)


def test_metadata_that_are_no_unicode_stop_neither_a_run_nor_a_draft(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = write(
        tmp_path / "view.mkv", pictures_of(1), metadata={"title": "QQQQ"}, of_stream={"stereo_mode": "left_right"}
    )
    path.write_bytes(path.read_bytes().replace(b"QQQQ", b"Q\xff\xe4Q"))
    assert "(left_right)" in remarks(path, caplog)
    assert header(path, "view").fps == FPS


@pytest.mark.parametrize("matrix", [(-1, 0, 0, 1), (1, 0, 0, -1), (0, 1, 1, 0)])
def test_films_to_be_shown_mirrored_are_refused(matrix: tuple[int, int, int, int], tmp_path: Path) -> None:
    """The first of these was turned upside down, the second read as it is: players and OpenCV differ as well."""
    path = tmp_path / "selfie.mp4"
    write_video(path, 3 * [picture(1, 3)])
    content, unit = path.read_bytes(), 0x10000
    upright = struct.pack(">9i", unit, 0, 0, 0, unit, 0, 0, 0, 0x40000000)
    a, b, c, d = (unit * entry for entry in matrix)
    place = content.index(upright, content.index(b"tkhd"))
    told = struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 0x40000000)
    path.write_bytes(content[:place] + told + content[place + 36 :])
    with pytest.raises(SequenceError, match=r"selfie\.mp4 is to be shown mirrored"):
        open_clip(path, "selfie")


def test_files_joined_byte_by_byte_are_refused(tmp_path: Path) -> None:
    """Their clocks begin anew: images were sorted into one another."""
    one = write(tmp_path / "one.ts", pictures_of(1)).read_bytes()
    (tmp_path / "view.ts").write_bytes(one + one)
    with pytest.raises(SequenceError, match=r"view\.ts has time stamps that run back, from .* were files joined"):
        open_clip(tmp_path / "view.ts", "view")


@pytest.mark.parametrize(
    ("codec", "pix_fmt", "full"),
    [("libx264", "yuv420p", False), ("libx264", "yuvj420p", True), ("libx265", "yuv420p10le", False)],
)
def test_grey_levels_do_not_depend_on_range_and_bits(codec: str, pix_fmt: str, full: bool, tmp_path: Path) -> None:
    steps = np.repeat(np.linspace(0, 255, 8).round().astype(np.uint8), 16)
    ramp = np.repeat(np.tile(steps, (96, 1))[:, :, None], 3, axis=2)
    path = write(tmp_path / "ramp.mp4", 3 * [ramp], codec=codec, pix_fmt=pix_fmt, options={"crf": "2"})
    with av.open(str(path)) as container:
        assert (container.streams.video[0].codec_context.color_range == 2) == full
    found = open_clip(path, "ramp")[2].read(1)
    assert found is not None
    assert np.abs(found.astype(int) - ramp).max() <= 6  # 16 of the other range
