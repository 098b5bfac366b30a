"""The job that follows points: its files, resuming to the same result, named points, one view, mistakes."""

from __future__ import annotations

import csv
import json
import signal
import sys
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
import test_following as following
from matplotlib.figure import Figure
from typer.testing import CliRunner

from tracker.cameras.rig_layouts import save_rig
from tracker.foundation.errors import ConfigError, MatchingError, SequenceError, TrackerError
from tracker.images import film
from tracker.points.following.record import read
from tracker.running.cli import app
from tracker.running.jobs import _following, execute, load_job

N_FRAMES = 7
rig, frames = following.rig, following.frames

CONFIG = """
name = "plane"
picture_frames = 4
cloud_frames = 4
saved_frames = 2
[reading]
use = "images"
path = "images/{view}_{frame}.png"
rig = "rig.toml"
fps = 50.0
[surface.growth]
step_px = 8
"""


@pytest.fixture(scope="module")
def folder(rig, frames, tmp_path_factory):
    folder = tmp_path_factory.mktemp("recording")
    (folder / "images").mkdir()
    save_rig(rig, folder / "rig.toml")
    for frame in frames[:N_FRAMES]:
        for name, image in zip(rig.names, frame.images, strict=True):
            cv2.imwrite(str(folder / "images" / f"{name}_{frame.index:03d}.png"), image)
    (folder / "follow.toml").write_text(CONFIG)
    return folder


@pytest.fixture(scope="module")
def outcome(folder):
    return execute(load_job("follow", folder / "follow.toml"), folder / "out")


@pytest.fixture
def small_figures(monkeypatch):
    """The two figures at the end of a job, a second each, are empty: the command and others draw them."""
    for name in ("trajectories_figure", "counts_figure"):
        monkeypatch.setattr(f"tracker.running.jobs.follow.{name}", lambda *_: Figure((1, 1)))


def table(folder):
    return list(csv.DictReader((folder / "trajectories.csv").read_text().splitlines()))


def test_the_command_writes_trajectories_clouds_pictures_and_a_report(folder):
    out = folder / "by_command"
    arguments = ["follow", str(folder / "follow.toml"), "--output", str(out), "--frames", "0:5"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert "found again" in result.output
    summary = json.loads((out / "follow.json").read_text())
    rows = table(out)
    assert summary["n_frames"] == 5
    assert len({row["point"] for row in rows}) == summary["n_points"] - summary["n_removed"]
    assert (out / "points_000004.jpg").stat().st_size > 5000
    assert b"end_header" in (out / "points_000004.ply").read_bytes()
    assert cv2.imread(str(out / "trajectories.png")).std() > 5
    report = (out / "report.html").read_text()
    assert report.count("data:image/") == 4
    assert "http" not in report


def test_velocities_of_the_table_are_those_of_the_plane(outcome):
    rows = [row for row in table(outcome.folder) if row["frame"] == "3" and row["vx_m_s"]]
    assert len(rows) > 100
    velocity, sigma = (
        np.array([[float(row[f"{kind}{axis}_m_s"]) for axis in "xyz"] for row in rows]) for kind in ("v", "sigma_v")
    )
    places = np.array([[float(row[f"{axis}_m"]) for axis in "xyz"] for row in rows])
    turn, shift = following.motion(3)
    at_rest = turn.inv().apply(places - shift)
    true = 25.0 * (following.where(at_rest, 4) - following.where(at_rest, 2))
    off = (velocity - true) / sigma
    # keys are shared by all frames, so that velocities are better than their sigmas
    assert 0.2 < np.sqrt(np.median(off**2)) < 1.0


def test_the_table_has_what_is_known_of_a_point(outcome, rig):
    rows = [row for row in table(outcome.folder) if row["frame"] == "5"]
    places = np.array([[float(row[f"{axis}_m"]) for axis in "xyz"] for row in rows])
    for view, camera in zip(rig.names, rig.cameras, strict=True):
        pixels = np.array([[float(row[f"{view}_{axis}_px"] or "nan") for axis in "xy"] for row in rows])
        assert np.nanmax(np.linalg.norm(camera.project(places) - pixels, axis=1)) < 1.0
    sigmas = np.array([[float(row[f"sigma_{axis}_m"]) for axis in "xyz"] for row in rows])
    mixed = np.array([[float(row[f"cov_{pair}_m2"]) for pair in ("xy", "xz", "yz")] for row in rows])
    correlations = mixed / sigmas[:, (0, 0, 1)] / sigmas[:, (1, 2, 2)]
    # all cameras look from one side, above: depth and height are measured together
    assert (np.abs(correlations) < 1).all()
    assert (np.abs(correlations).max(axis=1) > 0.5).all()
    assert {(row["born"], row["key"]) for row in rows if row["status"] == "followed"} >= {("0", "0")}
    assert all(row["key"] == "4" for row in rows if row["status"] == "rekeyed")
    assert all(float(row["drift_px"]) >= 0 for row in rows)


@pytest.mark.usefixtures("small_figures")
def test_an_interrupted_job_is_resumed_to_the_same_bytes(folder, outcome, monkeypatch):
    out, written = folder / "broken_off", _following.append

    def dies(path, frame):
        if frame.index == 5:
            raise OSError("the disk is full")
        written(path, frame)

    monkeypatch.setattr(_following, "append", dies)
    job = load_job("follow", folder / "follow.toml")
    with pytest.raises(OSError, match="disk"):
        execute(job, out)
    monkeypatch.setattr(_following, "append", written)
    assert execute(job, out, resume=True).n_frames == N_FRAMES
    for name in ("points.bin", "trajectories.csv", "points_000004.ply"):
        assert (out / name).read_bytes() == (outcome.folder / name).read_bytes()


@pytest.mark.usefixtures("small_figures")
def test_ctrl_c_leaves_a_usable_result(folder, monkeypatch):
    written = _following.append

    def interrupted(path, frame):
        if frame.index == 4:
            raise KeyboardInterrupt
        written(path, frame)

    monkeypatch.setattr(_following, "append", interrupted)
    outcome = execute(load_job("follow", folder / "follow.toml"), folder / "ctrl_c")
    assert outcome.interrupted
    assert outcome.n_frames == 4
    assert "interrupted" in (outcome.folder / "report.html").read_text()
    assert {row["frame"] for row in table(outcome.folder)} == {"0", "1", "2", "3"}


@pytest.mark.usefixtures("small_figures")
def test_a_job_without_a_saved_state_is_not_resumed(folder, monkeypatch):
    out = folder / "early"
    job = load_job("follow", folder / "follow.toml", ("saved_frames=100", "reading.stop=3"))
    execute(job, out)
    with pytest.raises(SequenceError, match="no saved state to go on from"):
        execute(job, out, resume=True)


def test_named_points_keep_their_names(folder):
    named = "points.left_hip=[80, 70]", "points.right_hip=[120.5, 71.25]", 'lines=[["left_hip", "right_hip"]]'
    outcome = execute(load_job("follow", folder / "follow.toml", named), folder / "named")
    rows = table(outcome.folder)
    with film.opened(outcome.folder / "figure.mp4") as container:
        drawn = [image.to_ndarray(format="bgr24") for image in container.decode(video=0)]
    assert len(drawn) == N_FRAMES
    # the line is drawn in the image and alone beside it, and moves
    alone = [picture[:, picture.shape[1] // 2 :].min(axis=2) < 128 for picture in drawn]
    assert all(50 < line.sum() < 2000 for line in alone)
    assert (alone[0] != alone[-1]).sum() > 50
    assert {row["point"] for row in rows} == {"left_hip", "right_hip"}
    assert len(rows) == 2 * N_FRAMES
    first = read(outcome.folder / "points.bin", 3)[:2]["pixels"][:, 1]
    np.testing.assert_allclose(first, [[80, 70], [120.5, 71.25]])
    sigmas = np.array([[float(row[f"sigma_{axis}_m"]) for axis in "xyz"] for row in rows]).reshape(N_FRAMES, 2, 3)
    # of the matches across views; another match comes to it in each later frame
    assert (sigmas[0] < sigmas[1]).all()
    assert (sigmas[0] > 0.3 * sigmas[1]).all()
    trc = (outcome.folder / "trajectories.trc").read_text().splitlines()
    assert "left_hip\t\t\tright_hip" in trc[3]
    assert len(trc) == 6 + N_FRAMES


@pytest.mark.usefixtures("small_figures")
def test_c3d_has_the_points_seen_longest_and_the_named_ones(folder):
    named = ("points.left_hip=[80, 70]", "c3d=true", "reading.stop=3")
    ezc3d = pytest.importorskip("ezc3d")
    outcome = execute(load_job("follow", folder / "follow.toml", ("c3d=true", "most_markers=40")), folder / "c3d")
    read = ezc3d.c3d(str(outcome.folder / "trajectories.c3d"))
    labels = read["parameters"]["POINT"]["LABELS"]["value"]
    assert len(labels) == 40
    assert read["parameters"]["POINT"]["RATE"]["value"] == [50.0]
    rows = {(row["point"], int(row["frame"])): row for row in table(outcome.folder)}
    for n, label in enumerate(labels):
        for t in range(N_FRAMES):
            row, place = rows.get((label.removeprefix("p"), t)), read["data"]["points"][:3, n, t]
            residual = read["data"]["meta_points"]["residuals"][0, n, t]
            if row is None:
                assert residual == -1
                continue
            np.testing.assert_allclose(place, [1000 * float(row[f"{axis}_m"]) for axis in "xyz"], atol=1e-2)
            assert 1 <= residual <= 127
    outcome = execute(load_job("follow", folder / "follow.toml", named), folder / "c3d_named")
    read = ezc3d.c3d(str(outcome.folder / "trajectories.c3d"))
    assert read["parameters"]["POINT"]["LABELS"]["value"] == ["left_hip"]


def test_without_ezc3d_nothing_is_begun(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    with pytest.raises(ConfigError, match="c3d = true needs the Python package ezc3d: pip install ezc3d"):
        execute(load_job("follow", folder / "follow.toml", ("c3d=true",)), folder / "no_ezc3d")
    assert not (folder / "no_ezc3d").exists()


@pytest.mark.usefixtures("small_figures")
def test_snakes_are_led_in_a_view(folder, rig):
    patch = ("snakes.patch.points=[[80, 60], [120, 60], [120, 100], [80, 100]]", "snake.min_edge_grey=0.2")
    job = load_job("follow", folder / "follow.toml", (*patch, 'snakes.patch.view="left"'))
    outcome = execute(job, folder / "snakes")
    with (outcome.folder / "snakes.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["view"] == "left"]
    assert {int(row["frame"]) for row in rows} == set(range(N_FRAMES))
    assert all(int(row["leading"]) >= 6 for row in rows if row["frame"] != "0")
    assert cv2.imread(str(outcome.folder / "snakes.jpg")).std() > 5
    assert "<h2>Snakes</h2>" in (outcome.folder / "report.html").read_text()
    assert load_job("follow", outcome.folder / "config.toml").snakes == job.snakes


@pytest.mark.usefixtures("small_figures")
def test_joints_beside_the_surface_move_with_it(folder, rig):
    places = np.array([[0.01, 0.0, -0.03], [-0.01, 0.01, -0.05]])
    pixels = rig.project(places)
    clicks = tuple(
        f"key_points.{name}.{view}=[{pixels[v, k, 0]:.3f}, {pixels[v, k, 1]:.3f}]"
        for k, name in enumerate(("knee", "hip"))
        for v, view in enumerate(rig.names[:2])
    )
    outcome = execute(load_job("follow", folder / "follow.toml", clicks), folder / "joints")
    rows = list(csv.DictReader((outcome.folder / "key_points.csv").read_text().splitlines()))
    assert [row["key_point"] for row in rows[:2]] == ["knee", "hip"]
    for row in rows:
        true = following.where(places[("knee", "hip").index(row["key_point"])], int(row["frame"]))
        assert np.linalg.norm([float(row[f"{axis}_m"]) for axis in "xyz"] - true) < 4e-4
        assert float(row["spread_m"]) < 5e-4
        assert 25 <= int(row["points_around"]) <= 40


def test_clicks_beside_the_surface_are_those_of_the_images_that_are_followed(folder, rig):
    place = np.array([[0.01, 0.0, -0.03]])
    half = [camera.project(place)[0] * (1, 0.5) for camera in rig.cameras[:2]]
    clicks = [f"key_points.knee.{name}=[{x}, {y}]" for name, (x, y) in zip(rig.names, half, strict=False)]
    job = load_job("follow", folder / "follow.toml", (*clicks, "surface.preparation.odd_lines_only=true"))
    np.testing.assert_allclose(job._around(rig).keywords["places"], place, atol=1e-6)


@pytest.mark.usefixtures("small_figures")
def test_a_recording_that_goes_dark_is_told_as_lost(folder, rig, frames):
    (folder / "dark").mkdir()
    for frame in frames[:N_FRAMES]:
        for name, image in zip(rig.names, frame.images, strict=True):
            shown = image if frame.index < 3 else np.full_like(image, 20)
            cv2.imwrite(str(folder / "dark" / f"{name}_{frame.index:03d}.png"), shown)
    dark = ('reading.path="dark/{view}_{frame}.png"', "density.every_frames=2")
    snake = ('snakes.patch.view="left"', "snakes.patch.points=[[80, 60], [120, 60], [120, 100], [80, 100]]")
    config = load_job("follow", folder / "follow.toml", (*dark, *snake, "snake.min_edge_grey=0.2"))
    outcome = execute(config, folder / "gone_dark")
    assert outcome.n_seen_last == 0
    assert outcome.median_sigma_mm is None
    assert any("0 are seen at last" in warning for warning in outcome.warnings)
    assert any(text.startswith("no new surface could be measured in frame 4") for text in outcome.warnings)
    assert any("snake patch: doubtful in 4 frames, the first one 3" in warning for warning in outcome.warnings)
    assert "0 are seen at last" in (outcome.folder / "report.html").read_text()
    assert {row["frame"] for row in table(outcome.folder)} == {"0", "1", "2"}


def test_one_view_is_followed_in_px(folder):
    job = load_job("follow", folder / "follow.toml", ('view="middle"', "points=[[80, 70], [120, 71]]"))
    outcome = execute(job, folder / "flat")
    rows = table(outcome.folder)
    assert len(rows) == 2 * N_FRAMES
    assert set(rows[0]) >= {"x_px", "sigma_x_px", "vx_px_s"}
    assert not list(outcome.folder.glob("*.ply"))
    dense = execute(load_job("follow", folder / "follow.toml", ('view="middle"', "reading.stop=4")), folder / "dense")
    assert dense.n_points > 100
    assert 0 < dense.median_sigma_px < 0.3
    assert all(row["x_px"] for row in table(dense.folder))


@pytest.mark.parametrize(
    ("overrides", "error", "message"),
    [
        (('view="midle"',), ConfigError, 'view = "midle": no such view; did you mean "middle"'),
        (("points.hip=[80, 70]", 'lines=[["hip", "knee"]]'), ConfigError, 'lines: no point is called "knee"'),
        (("points=[[80, 70], [2, 3]]",), MatchingError, r"point 1 at \[2, 3\]: seen by 1 of 3 views; in view"),
        (
            ('view="middle"', "points=[[80, 70], [196, 70]]"),
            MatchingError,
            r"point 1 at \[196, 70\]: a patch of 15 px around it is not within the image of 200 x 160 px",
        ),
        (("points=[[80, 70, 1]]",), ConfigError, "points"),
        (("following.template=last",), ConfigError, "previous"),
        (("surface.template=up",), ConfigError, 'template = "up": no such view'),
        (('reading.views=["left"]',), ConfigError, 'say view = "left"'),
        (
            ("snakes.arm.points=[[80, 60], [120, 60], [120, 100]]",),
            ConfigError,
            "snakes.arm: in which view. expected view = one of left, middle, right",
        ),
        (("snakes.arm.points=[[80, 60], [120, 60]]",), ConfigError, r"\[snakes.arm\]: \[points\]: 2 points"),
        (("snakes.arm.point=[[80, 60]]",), ConfigError, r'\[snakes.arm\]: unknown key "point"; did you mean "points"'),
        (
            ('snakes.arm.view="left"', "snakes.arm.points=[[80, 60], [120, 60], [120, 300]]"),
            ConfigError,
            r"snakes.arm: point \[120, 300\] lies outside the image of 200 x 160 px",
        ),
        (("key_points.knee.left=[80, 70]",), ConfigError, "key point knee: clicked in 1 view, expected two or more"),
        (
            ("key_points.knee.left=[80, 70]", "key_points.knee.lefft=[80, 70]"),
            ConfigError,
            'key point knee: no view "lefft"; did you mean "left"',
        ),
        (
            ("key_points.knee.left=[80, 70]", "key_points.knee.middle=[80, 140]"),
            ConfigError,
            "its rays miss one another by",
        ),
        (
            ("key_points.knee.left=[100, 80]", "key_points.knee.middle=[100, 80]", "key_point_reach_mm=1"),
            MatchingError,
            "followed points within 1 mm, expected 6",
        ),
    ],
)
def test_mistakes_are_named_and_leave_nothing(folder, overrides, error, message):
    with pytest.raises(error, match=message):
        execute(load_job("follow", folder / "follow.toml", overrides), folder / "mistaken")
    assert not (folder / "mistaken").exists()
    assert issubclass(error, TrackerError)


# Ctrl-C: what it keeps, and what the command says.


@pytest.mark.usefixtures("small_figures")
def test_ctrl_c_saves_the_state_that_the_job_goes_on_from(folder, outcome, monkeypatch):
    out, written = folder / "stopped", _following.append

    def stopped(path, frame):
        written(path, frame)
        if frame.index == 4:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(_following, "append", stopped)
    job = load_job("follow", folder / "follow.toml", ("saved_frames=100",))
    told = execute(job, out)
    assert (told.interrupted, told.n_frames) == (True, 5)
    monkeypatch.setattr(_following, "append", written)
    assert execute(job, out, resume=True).n_frames == outcome.n_frames
    for name in ("points.bin", "trajectories.csv"):
        assert (out / name).read_bytes() == (outcome.folder / name).read_bytes()


def test_ctrl_c_before_the_first_frame_leaves_nothing(folder, monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("tracker.running.jobs._following.measure_surface", stopped)
    told = CliRunner().invoke(app, ["follow", str(folder / "follow.toml"), "--output", str(folder / "at_once")])
    assert told.exit_code == 130, told.output
    assert not (folder / "at_once").exists()


@dataclass
class Outcome:
    interrupted: bool = True


def test_an_interrupted_job_ends_with_the_code_of_ctrl_c(folder, monkeypatch):
    monkeypatch.setattr("tracker.running.cli.done", lambda *_: Outcome())
    told = CliRunner().invoke(app, ["follow", str(folder / "follow.toml")])
    assert told.exit_code == 130, told.output
