"""Cameras that film now, rehearsed with films that are played at their own rate: what comes meanwhile is dropped."""

from __future__ import annotations

import functools
import http.server
import itertools
import json
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from numbered_pictures import FPS, HEIGHT, N_FRAMES, VIEWS, WIDTH, picture, seen
from staged import Server

from tracker.cameras.frame import Frame
from tracker.cameras.rig_layouts import load_rig, save_rig
from tracker.foundation.arrays import Image
from tracker.foundation.errors import CalibrationError, ConfigError, SequenceError, TrackerError
from tracker.foundation.progress import silent
from tracker.images.reading import Reading, Sequence, _cameras
from tracker.images.reading.live import LiveReading, counts_of
from tracker.results.result import load_result, remarks
from tracker.running.jobs import execute, load_job
from tracker.running.programs import load_run
from tracker.running.viewing.viewer import LiveRun
from tracker.synthesis.simulation.sequence import Recipe, write_sequence


def films(folder: Path, **settings: object) -> LiveReading:
    return LiveReading(path=str(folder / "{view}.mp4"), rig=folder / "rig.toml", fps=float(FPS), **settings)


def test_it_is_a_reading_like_the_others(numbered: Path) -> None:
    reading = films(numbered)
    assert isinstance(reading, Reading)
    opened = reading.open()
    assert isinstance(opened, Sequence)
    assert counts_of(opened) is opened.counts
    assert opened.interval_s == 1 / FPS
    assert opened.plates == opened.backdrops == (None, None, None)


def test_frames_come_at_the_films_own_rate_and_show_one_moment(numbered: Path) -> None:
    opened, begin = films(numbered).open(), time.monotonic()
    frames = list(opened.frames())
    assert time.monotonic() - begin > 0.9 * (N_FRAMES - 1) / FPS
    for frame in frames:
        views, numbers = zip(*(seen(image) for image in frame.images), strict=True)
        assert views == (0, 1, 2)
        assert set(numbers) == {frame.index}
        assert frame.time_s == pytest.approx(frame.index / FPS, abs=0.01)
    counts = opened.counts
    assert counts.tracked == len(frames)
    assert counts.tracked + counts.dropped == frames[-1].index + 1
    assert counts.apart_ms < 20


def test_what_comes_while_a_frame_is_at_work_is_dropped_and_counted(numbered: Path) -> None:
    opened = films(numbered).open()
    begin, last = time.monotonic(), -1
    for frame in opened.frames():
        assert frame.index > last, "none twice, none from before"
        last = frame.index
        time.sleep(0.15)
    assert opened.counts.tracked <= 8
    assert opened.counts.dropped == last + 1 - opened.counts.tracked > 8
    assert time.monotonic() - begin < 3, "nothing was queued"
    assert f"{opened.counts.dropped} dropped that came meanwhile" in opened.counts.told()


def test_who_was_busy_for_long_is_led_back_to_now_in_steps(numbered: Path) -> None:
    """Or whoever moves on while a start is looked for would be lost in the next frame."""
    numbers, longest = [], 1.5 * _cameras._STRIDE_S * FPS + 1
    for frame in films(numbered).open().frames():
        views, shown = zip(*(seen(image) for image in frame.images), strict=True)
        assert (views, set(shown)) == ((0, 1, 2), {frame.index}), "images of one moment"
        numbers.append(frame.index)
        time.sleep(0.6 if frame.index == 0 else 0.01)
    steps = [after - before for before, after in itertools.pairwise(numbers)]
    assert longest >= max(steps) > 1
    assert numbers[-1] >= N_FRAMES - 2
    assert len(numbers) < N_FRAMES, "those between the steps are dropped"


def test_it_ends_when_its_time_is_over(numbered: Path) -> None:
    opened = films(numbered, seconds=0.3).open()
    assert opened.n_frames == round(0.3 * FPS)
    assert max(frame.index for frame in opened.frames()) <= opened.n_frames


def test_images_are_delivered_as_is_asked(numbered: Path) -> None:
    opened = films(numbered, downscale=2, background=str(numbered / "plate_{view}.png")).open()
    frame = next(opened.frames())
    assert [image.shape for image in frame.images] == [(HEIGHT // 2, WIDTH // 2, 3)] * 3
    assert [camera.size for camera in opened.rig.cameras] == [(WIDTH // 2, HEIGHT // 2)] * 3
    assert [plate.picture.shape for plate in opened.plates] == [(HEIGHT // 2, WIDTH // 2, 3)] * 3


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({}, "expected cameras = "),
        ({"cameras": {"east": 0}, "path": "{view}.mp4"}, "expected cameras = "),
        ({"cameras": {"eats": 0}}, 'no camera "eats" in the rig; did you mean "east"'),
        ({"cameras": {"east": 0}}, "north, west missing"),
        ({"path": "{view}.avi"}, 'view "east": no file'),
        ({"cameras": dict.fromkeys(VIEWS, 97)}, 'view "east": no camera number 97 on this machine'),
        ({"cameras": dict.fromkeys(VIEWS, "http://127.0.0.1:9/x")}, "no stream that can be read"),
        ({"path": "{view}.mp4", "background": "median"}, "bring plates"),
    ],
)
def test_what_cannot_be_opened_is_told_before_anything_begins(
    numbered: Path, settings: dict[str, object], told: str
) -> None:
    if "path" in settings:
        settings = {**settings, "path": str(numbered / str(settings["path"]))}
    with pytest.raises((ConfigError, SequenceError), match=told):
        LiveReading(rig=numbered / "rig.toml", **settings).open()


def test_cameras_are_not_calibrated_live(numbered: Path) -> None:
    with pytest.raises(ConfigError, match="calibrated from a recording"):
        films(numbered).open_uncalibrated()


def test_images_of_another_size_than_calibrated_are_refused(numbered: Path, tmp_path: Path) -> None:
    rig = load_rig(numbered / "rig.toml")
    save_rig(rig.downscaled(2), tmp_path / "rig.toml")
    with pytest.raises(CalibrationError, match="64x48 px, the rig was calibrated at 32x24"):
        replace(films(numbered), rig=tmp_path / "rig.toml").open()


def test_an_address_is_read_as_a_stream(numbered: Path) -> None:
    """What one is, FFmpeg finds out by its beginning: rtsp:// as http://."""
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(numbered))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_address[1]}"
        reading = LiveReading(cameras={v: f"{address}/{v}.mp4" for v in VIEWS}, rig=numbered / "rig.toml")
        shown = []
        with pytest.raises(SequenceError, match="the stream has ended"):
            shown.extend(image.image() for _, image in reading.open().sources[2].images())
        views, numbers = zip(*map(seen, shown), strict=True)
        assert set(views) == {2}
        assert list(numbers) == list(range(N_FRAMES - len(numbers), N_FRAMES)), (
            "what came while it was opened is left out"
        )
        server.shutdown()


class Scripted:
    """Cameras that give some images, and then nothing, or an error."""

    def __init__(self, fault: str = "") -> None:
        self.fault = fault

    def __call__(self, source: _cameras.Source) -> Iterator[tuple[None, Image]]:
        for number in range(3):
            time.sleep(0.02)
            yield None, picture(VIEWS.index(source.view), number)
        if self.fault and source.view == "north":
            raise SequenceError(self.fault)
        threading.Event().wait(3)


@pytest.mark.parametrize(
    ("fault", "told"), [("", "east, camera north, camera west: no image for 0 s"), ("pulled out", "pulled out")]
)
def test_a_camera_that_falls_silent_ends_the_run(
    numbered: Path, fault: str, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_cameras.Source, "images", lambda source: Scripted(fault)(source))
    monkeypatch.setattr(_cameras, "_SILENT_S", 0.4)
    opened = LiveReading(cameras=dict.fromkeys(VIEWS, 0), rig=numbered / "rig.toml").open()
    frames: list[Frame] = []
    with pytest.raises(SequenceError, match=told):
        frames.extend(opened.frames())


JOB = """
passes = {passes}
inspection = {inspection}
persons = [{{ name = "anna", model = "gavrila22", stature_m = 1.7, shape = "{shape}" }}]
[reading]
use = "live"
path = "{{view}}.mp4"
rig = "rig.toml"
"""


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"passes": 2}, "passes = 1$"),
        ({"inspection": "true"}, "inspection = false$"),
        ({"shape": "recording"}, 'shape = "model" of anna$'),
        ({"passes": 2, "shape": "recording"}, 'passes = 1; shape = "model" of anna$'),
    ],
)
def test_what_looks_at_frames_twice_is_refused(numbered: Path, settings: dict[str, object], told: str) -> None:
    usual = {"passes": 1, "inspection": "false", "shape": "model"}
    path = numbered / "job.toml"
    path.write_text(JOB.format(**(usual | settings)))
    with pytest.raises(ConfigError, match=f"the cameras deliver each frame once, expected {told}"):
        load_job("track", path)
    path.write_text(JOB.format(**usual))
    with pytest.raises(TrackerError, match="run anew without --resume"):
        load_job("track", path).open(numbered)


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The configuration of a live run of some simulated films, which begins with the true pose."""
    folder = tmp_path_factory.mktemp("live")
    write_sequence(Recipe("arm_swing", seconds=0.6, size=(360, 288)), folder)
    (folder / "live.toml").write_text("""
passes = 1
inspection = false
persons = [{ name = "person1", model = "model.toml" }]
initialization = { use = "given", poses = "truth_poses.csv" }
recordings = ["run_json", "journal"]
[reading]
use = "live"
path = "{view}.mp4"
rig = "rig.toml"
background = "background/{view}.png"
""")
    return folder / "live.toml"


def test_a_live_run_tells_what_it_dropped_and_its_result_is_whole(sequence: Path, tmp_path: Path) -> None:
    outcome = execute(load_job("track", sequence), tmp_path / "result")
    (told,) = outcome.remarks
    assert told.startswith(f"live: {outcome.n_frames} frames in ")
    details = json.loads((tmp_path / "result" / "run.json").read_text())
    live = details["live"]
    assert live["tracked"] == outcome.n_frames
    assert f"{live['dropped']} dropped" in told
    result = load_result(tmp_path / "result")
    assert live["tracked"] + live["dropped"] == result.frames[-1] + 1
    assert remarks(tmp_path / "result", details) == (), "nobody is told to resume it"


def test_a_live_run_is_looked_at_with_sigma_and_doubt(sequence: Path) -> None:
    live = LiveRun(load_run(sequence), server := Server(), silent)
    while not live.done.is_set():
        live.viewer.serve(0.05)
    live.viewer.serve(0.1)
    live.close()
    assert live.fault is None
    told = server.nodes[""].content
    assert "person1: " in told
    assert "sigma of the joints: " in told
    assert server.nodes["frame"].max >= live.viewer.n_frames - 1
    assert isinstance(live.viewer.pictures.of(live.viewer.shown), tuple)
