"""Views out of step: found by what moves before the first frame, corrected, told, and kept with the result."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest
from numbered_pictures import KINDS, VIEWS, pictures_of, shown, write_video

from tracker.foundation.arrays import Array
from tracker.foundation.errors import ConfigError
from tracker.images.inspection import Survey, findings
from tracker.images.inspection._delays import Delays, Tangents, delays_of
from tracker.images.reading._timeline import ViewOffset, chosen_offsets, later
from tracker.images.reading.video import VideoReading
from tracker.results.result import load_result
from tracker.running.jobs import execute, load_job
from tracker.running.jobs._delivery import in_step
from tracker.running.jobs._messages import looked_at
from tracker.running.viewing.images import images_of
from tracker.synthesis.simulation.sequence import Recipe, write_sequence

N_VIEWS = 4


def touching(times: Array, noise: float = 0.02, moves: float = 1.0) -> Tangents:
    """Angles of planes that touch somebody who moves, each view (V, T) at times of its own, frames."""
    rng = np.random.default_rng(2)
    waves = rng.normal(size=(N_VIEWS, N_VIEWS, 2, 3)) * moves / 3
    found = {}
    for one, other in itertools.combinations(range(len(times)), 2):
        ends = np.zeros((2, times.shape[1], 2))
        for k, v in enumerate((one, other)):
            for end in range(2):
                heights = waves[one, other, end]
                ends[k, :, end] = sum(h * np.sin(times[v] / (4 + 3 * n) + n) for n, h in enumerate(heights))
        found[one, other] = ends + rng.normal(0, noise, ends.shape)
    return found


def clocks(n_frames: int = 100, **late: Array | float) -> Array:
    """(V, T) what frame of the true clock a view shows; `v2=3` comes three frames late."""
    times = np.tile(np.arange(n_frames, dtype=float), (N_VIEWS, 1))
    for name, by in late.items():
        times[int(name[1:])] -= by
    return times


def found(times: Array, **how: float) -> Delays:
    return delays_of(touching(times, **how), len(times))


def test_views_in_step_are_not_late() -> None:
    delays = found(clocks())
    assert delays.told.all()
    assert not delays.late.any()
    assert not delays.part.any()


@pytest.mark.parametrize("by", [2, -7, 31])
def test_whole_frames_are_found(by: int) -> None:
    delays = found(clocks(v2=by))
    assert (delays.late == np.array([0, 0, by, 0])[:, None]).all()


def test_two_views_tell_each_other() -> None:
    delays = found(clocks(v1=4)[:2])
    assert (np.diff(delays.late, axis=0) == 4).all()


@pytest.mark.parametrize("by", [0.5, -0.5])
def test_parts_of_a_frame_are_told(by: float) -> None:
    delays = found(clocks(v3=by))
    assert not delays.late.any()
    assert delays.part[3] == pytest.approx(by, abs=0.15)
    assert not delays.part[:3].any()


def test_a_dropped_frame_is_found_where_it_is() -> None:
    delays = found(clocks(v1=np.where(np.arange(100) < 55, 0, -1)))
    changes = np.flatnonzero(np.diff(delays.late[1])) + 1
    assert not np.delete(delays.late, 1, axis=0).any()
    assert delays.late[1, [0, -1]].tolist() == [0, -1]
    assert changes == pytest.approx([55], abs=8)


def test_a_clock_at_another_rate_is_late_by_more_and_more() -> None:
    frames = np.arange(1500)
    delays = delays_of(touching(clocks(1500, v1=0.001 * frames)), N_VIEWS)
    assert not np.delete(delays.late, 1, axis=0).any()
    assert np.abs(delays.late[1] - 0.001 * frames).max() <= 1
    assert delays.late[1, 0] == 0
    assert delays.late[1, -1] in (1, 2)


def test_nothing_is_told_where_nothing_moves() -> None:
    delays = found(clocks(v2=5), moves=0.0)
    assert not delays.told.any()
    assert not delays.late.any()
    assert not delays_of({}, 1).told.any()


def test_offsets_that_change() -> None:
    dropped = ViewOffset(((0, 0), (5, -3)))
    assert [dropped.number(frame) for frame in range(10)] == [0, 1, 2, 3, 4, -1, -1, 4, 5, 6]
    repeated = ViewOffset(((0, -1), (3, 1)))
    assert [repeated.number(frame) for frame in range(6)] == [-1, 0, 1, 4, 5, 6]
    assert repeated.length(7) == 6
    assert chosen_offsets(("a", "b"), {"b": 2})[0].number(4) == 4
    assert later(3, {0: 0, 7: -1}) == ((0, 3), (7, 2))
    assert later(((0, 3), (10, 2)), {0: 1, 7: 0}) == ((0, 4), (7, 3), (10, 2))
    assert later(((0, 0), (4, 1)), {0: 0, 4: -1}) == 0


@pytest.mark.parametrize("wrong", ["2.5", "[[3, 1]]", "[[0, 1], [0, 2]]", "[]", "true", "[[0, 1, 2]]"])
def test_offsets_that_are_none_are_named(wrong: str, tmp_path: Path) -> None:
    config = tmp_path / "run.toml"
    config.write_text(
        '[reading]\nuse = "video"\npath = "{view}.mp4"\nrig = "rig.toml"\n'
        f'offsets = {{ a = {wrong} }}\n[[persons]]\nmodel = "human"\n'
    )
    with pytest.raises(ConfigError, match=r"offsets\.a.*expected a number of frames, or pairs \[frame, offset\]"):
        load_job("track", config)


@pytest.mark.parametrize("kind", KINDS)
def test_pairs_of_a_frame_and_an_offset_are_read(kind: str, numbered: Path) -> None:
    plain = shown(KINDS[kind](numbered))
    moved = shown(KINDS[kind](numbered, offsets={"north": ((0, 0), (2, 1))}, stop=len(plain) - 1))
    assert [one[0] for one in moved] == [one[0] for one in plain[:-1]]
    assert [one[1] for one in moved] == [one[1] for one in (*plain[:2], *plain[3:])]


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short recording in step; offsets that are given make it one that is not."""
    folder = tmp_path_factory.mktemp("walk")
    return write_sequence(Recipe("arm_swing", seconds=0.4, size=(256, 208)), folder / "sequence")


@pytest.fixture
def late(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, int]]:
    """What the looks at the first frames find, one after the other; then nothing."""
    looks: list[dict[str, int]] = []

    def delays(seen: Survey) -> Delays:
        told = looks.pop(0) if looks else {}
        every = [[told.get(name, 0)] * len(seen.foregrounds) for name in seen.rig.names]
        return Delays(np.array(every), np.zeros(len(every)), np.ones(len(every), dtype=np.bool_))

    made = cached_property(delays)
    made.__set_name__(Survey, "delays")
    monkeypatch.setattr(Survey, "delays", made)
    return looks


GIVEN = ["initialization.use=given", "initialization.poses=truth_poses.csv", "passes=1"]


def test_a_run_corrects_delays_and_keeps_them(late: list[dict[str, int]], walk: Path, tmp_path: Path) -> None:
    """Offsets that are wrong by some frames are a delay as any other; the second look finds one more."""
    late += [{"FRONT": -1, "BACK": 2}, {"BACK": 1}]
    said: list[str] = []
    wrong = ["reading.offsets={FRONT=1,BACK=-3}", "reading.start=3", "reading.stop=9"]
    asked = [*GIVEN, *wrong, 'recordings=["run_json","journal","report"]']
    execute(load_job("track", walk, asked), tmp_path / "out", progress=lambda what, *_: said.append(what))
    told = json.loads((tmp_path / "out" / "run.json").read_text())
    assert told["images"]["offsets"] == {"FRONT": 0, "BACK": 0}
    words = "views brought in step: FRONT was 1 image early, BACK was 3 images late"
    assert any(words in line for line in said)
    assert words in (tmp_path / "out" / "report.html").read_text()
    assert not told["findings"]
    result = load_result(tmp_path / "out")
    frames = list(images_of(result))
    assert [frame.index for frame in frames] == result.frames.tolist() == [3, 4, 5]
    assert {frame.position(v) - frame.index for frame in frames for v in range(4)} == {0}
    assert load_job("track", walk, asked).open(tmp_path / "out").sequence.n_frames == 3


def test_frames_without_an_image_of_a_late_view_are_left_out(late: list[dict[str, int]], walk: Path) -> None:
    late += [{"FRONT": -2}]
    job = load_job("track", walk, GIVEN)
    opened = job.open()
    seen = looked_at(opened, job.cycle(opened), 1)
    assert seen is not None
    corrected = in_step(opened.reading, opened.sequence, seen)
    assert [frame.index for frame in corrected.open().frames()] == list(range(2, 10))


def test_delays_are_told_and_left_where_that_is_asked_for(late: list[dict[str, int]], walk: Path) -> None:
    late += [{"FRONT": 3}]
    job = load_job("track", walk, [*GIVEN, "reading.in_step=off"])
    opened = job.open()
    seen = looked_at(opened, job.cycle(opened), 1)
    assert seen is not None
    assert in_step(opened.reading, opened.sequence, seen) is None
    assert any("try offsets = { FRONT = 3 }" in line for line in findings(seen))


def stamped(folder: Path, rig: Path, file: str = "cam_{v}.mp4") -> tuple[VideoReading, list[Array]]:
    """Three videos: the second camera began three images before, the third one has dropped its tenth image."""
    for v in range(3):
        write_video(folder / file.format(v=v), pictures_of(v, range(19) if v == 2 else range(20)))
    even = np.arange(20) / 25
    paths = {name: str(folder / file.format(v=v)) for v, name in enumerate(VIEWS)}
    recording = VideoReading(path=paths, rig=rig / "rig.toml", on_missing="skip")
    return recording, [5 + even, 5 + even - 3 / 25 + 0.008, 5 + np.delete(even, 10)]


def caliscope(folder: Path, times: list[Array], camera: str, name: str) -> None:
    rows = [(t, v) for v, own in enumerate(times) for t in own]
    lines = [f"{k},{v},{t:.7f}" for k, (t, v) in enumerate(sorted(rows))]
    (folder / name).write_text("\n".join([f"sync_index,{camera},frame_time", *lines]))


def freemocap_1(folder: Path, times: list[Array]) -> None:
    (folder / "timestamps").mkdir()
    for v, own in enumerate(times):
        lines = [f"{k},{1e9 * t:.1f}" for k, t in enumerate(own)]
        table = folder / "timestamps" / f"Camera_{v:03d}_synchronized_timestamps_human_readable.csv"
        table.write_text("\n".join([",0", *lines]))


def freemocap_2(folder: Path, times: list[Array]) -> None:
    tables = folder / "timestamps" / "camera_timestamps"
    tables.mkdir(parents=True)
    for v, own in enumerate(times):
        lines = [f"{k},{k + 40},{t - 5:.9f},{1e9 * t:.0f}" for k, t in enumerate(own)]
        head = "recording_frame_number,connection_frame_number,timestamp.from_recording_start.sec,timestamp.utc.seconds"
        (tables / f"take.camera{v}.timestamps.csv").write_text("\n".join([head, *lines]))


PROGRAMS = {
    "Caliscope": ("cam_{v}.mp4", lambda folder, times: caliscope(folder, times, "cam_id", "timestamps.csv")),
    "Caliscope before": (
        "port_{v}.mp4",
        lambda folder, times: caliscope(folder, times, "port", "frame_time_history.csv"),
    ),
    "FreeMoCap 1": ("Camera_00{v}_synchronized.mp4", freemocap_1),
    "FreeMoCap 2": ("take.camera.id{v}.idx{v}.mp4", freemocap_2),
}


@pytest.mark.parametrize("program", PROGRAMS)
def test_times_beside_videos_pair_their_images(
    program: str, numbered: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file, write = PROGRAMS[program]
    recording, times = stamped(tmp_path, numbered, file)
    write(tmp_path, times)
    found = shown(recording)
    assert found[0] == ((0, 0), (1, 3), (2, 0))
    assert found[9] == ((0, 9), (1, 12), (2, 9))
    assert found[10] == ((0, 10), (1, 13), None)
    assert found[11:] == [((0, k), (1, k + 3), (2, k - 1)) for k in range(11, 17)]
    assert "paired by its times, up to 8 ms apart" in caplog.text
    assert shown(replace(recording, in_step="off"))[0] == ((0, 0), (1, 0), (2, 0))


def test_times_that_are_not_of_the_videos_are_left_and_named(
    numbered: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    recording, times = stamped(tmp_path, numbered)
    caliscope(tmp_path, [times[0][:-1], *times[1:]], "cam_id", "timestamps.csv")
    assert shown(recording)[0] == ((0, 0), (1, 0), (2, 0))
    assert '19 times of view "east", whose video has 20 images: its times are not used' in caplog.text
    (tmp_path / "timestamps.csv").write_text("cam_id,time\n0,1\n")
    recording.open()
    assert "not a table of times that is known" in caplog.text
