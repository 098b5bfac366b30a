"""The report: what is in doubt first, numbers that are judged, joint angles to take along, and room on a telephone."""

from __future__ import annotations

import base64
import csv
import html
import io
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser import PROGRAM, browser
from doubted import in_doubt
from motions import LOST, N_FRAMES, Movement, made_up

import tracker
from tracker.cameras.frame import Frame
from tracker.foundation.errors import SequenceError
from tracker.results.recording._anatomical import IsbSeries, angles_of, joints_of
from tracker.results.recording._series import Series
from tracker.results.recording.csv_table import CsvTable
from tracker.results.recording.overlay import Overlay
from tracker.results.recording.plots import Plots
from tracker.results.recording.report import Report, head_numbers
from tracker.results.smoothed_result import Pictures, write_smoothed
from tracker.results.smoothing.rts import RauchTungStriebel
from tracker.tracking.doubt import Because, Doubt


def page_of(movement: Movement, folder: Path, **settings: object) -> str:
    (path,) = movement.record(Report(**{"pictures": 1, "player": False, **settings}), folder)
    return html.unescape(path.read_text(encoding="utf-8"))


def sure() -> Movement:
    """Somebody who is found in every frame."""
    movement = made_up("human")
    found = movement.steps[0].estimates
    steps = [step if not step.estimates[0].lost else replace(step, estimates=found) for step in movement.steps]
    return replace(movement, steps=steps)


def doubted() -> Movement:
    """The left arm jumps in three frames, in one of them two poses explain the right one."""
    movement = sure()
    jump, other = Doubt("left_arm", Because.JUMP, 0.3, 0.1), Doubt("right_arm", Because.IMPROBABLE, 0.1, 0.2)
    steps = list(movement.steps)
    for t, told in ((3, (jump,)), (4, (jump, other)), (5, (jump,))):
        steps[t] = replace(steps[t], estimates=(steps[t].estimates[0].doubting(told),))
    return replace(movement, steps=steps)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report and the tables of somebody of whom nothing is in doubt."""
    made = tmp_path_factory.mktemp("calm")
    sure().record(CsvTable(), made)
    page_of(sure(), made)
    return made


def test_what_is_in_doubt_comes_first_with_its_reasons(tmp_path: Path, folder: Path) -> None:
    calm, page = (folder / "report.html").read_text(), page_of(doubted(), tmp_path)
    assert "Tables beside" not in page, "there are none"
    body = calm.partition("<body>")[2]
    assert body.index("Nothing is in doubt.") < body.index('class="cards"')
    assert "Nothing is in doubt" not in page
    assert f"3 of {N_FRAMES} frames are in doubt:" in page
    told = re.findall(r"<li>(.*?)</li>", page)
    assert told == [f"left arm in 3: {Because.JUMP.phrase}", f"right arm in 1: {Because.IMPROBABLE.phrase}"]
    strip = re.findall(r'<i style="flex-grow[^>]* title="([^"]*)"', page)
    assert f"person1, frames 13 to 15: limb ambiguous. left arm: {Because.JUMP.phrase}; right arm: " in "|".join(strip)
    assert f'<td class="why">left arm: {Because.JUMP.phrase}; right arm: {Because.IMPROBABLE.phrase}</td>' in page
    # below the list the command that draws its first frame, the worst
    assert "<code>bodytrack show frame RESULT --frame 14</code>" in page.partition("Worst frames")[2]


def test_a_start_that_is_rather_wrong_is_a_doubt_though_no_frame_is_in_any(tmp_path: Path) -> None:
    movement = sure()
    steps = [replace(movement.steps[0], told_confidence=(0.06,)), *movement.steps[1:]]
    page = page_of(replace(movement, steps=steps), tmp_path)
    assert "is more likely wrong than right (confidence 0.06)" in page
    assert "Nothing is in doubt" not in page
    assert "frames are in doubt" not in page


def test_what_few_look_at_is_folded_away_and_tables_are_linked(folder: Path) -> None:
    page = (folder / "report.html").read_text()
    links = re.findall(r'href="([^":]+)"', page)
    assert links == ["poses.csv", "sigmas.csv", "joints.csv", "doubts.csv", "limbs.csv"]
    assert all((folder / name).is_file() for name in links)
    folded = re.findall(r"<details><summary>(.*?)</summary>(.*?)</details>", page, flags=re.DOTALL)
    assert [title.split()[0] for title, _ in folded] == ["Range", "Time", "Configuration"]
    open_part = re.sub(r"<details>.*?</details>", "", page, flags=re.DOTALL)
    assert "median standard deviation</th>" not in open_part
    assert "<pre>" not in open_part


def test_each_head_number_says_what_is_good_or_bad_about_it(tmp_path: Path) -> None:
    def judged(movement: Movement, n_frames: int = N_FRAMES, **summary: object) -> dict[str, tuple[str, str]]:
        series = Series(movement.scene)
        for step in movement.steps:
            series.add(step)
        context = replace(movement.context(tmp_path), n_frames=n_frames)
        found = head_numbers(series.summary() | summary, context)
        assert all(one.told for one in found)
        return {one.name: (one.value, one.verdict) for one in found}

    good = judged(sure())
    assert {verdict for _, verdict in good.values()} == {"good", ""}
    bad = judged(made_up("human"), N_FRAMES + 2)
    assert bad["lost"] == (str(LOST.stop - LOST.start), "bad")
    assert bad[f"frames of {N_FRAMES + 2}"][1] == "bad"
    assert judged(doubted())["with an ambiguous limb"] == ("3", "look")
    for share, verdict in ((0.8, "good"), (0.7, "look"), (0.3, "bad")):
        assert judged(sure(), mean_explained=share)["of the contour explained"] == (f"{share:.0%}", verdict)
    assert judged(sure(), mean_explained=None)["of the contour explained"] == ("-", "")


def test_joint_angles_are_told_left_beside_right_and_to_take_along(tmp_path: Path) -> None:
    movement = made_up("human")
    page = page_of(movement, tmp_path)
    link = re.search(r'<a download="(\w+\.csv)" href="data:text/csv;base64,([^"]+)"', page)
    assert link is not None
    assert link[1] == "person1_isb.csv"
    rows = list(csv.DictReader(io.StringIO(base64.b64decode(link[2]).decode())))
    assert len(rows) == N_FRAMES
    estimate, joints = movement.steps[0].estimates[0], joints_of(movement.scene.persons[0].body)
    names = [f"{joint.name}_{angle}" for joint in joints for angle in joint.angles]
    angles, sigmas = angles_of(joints, movement.scene.persons[0].body, estimate.q[None], estimate.covariance[None])
    for name, angle, sigma in zip(names, angles[0], sigmas[0], strict=True):
        for column, value in ((f"{name}_deg", angle), (f"{name}_sigma_deg", sigma)):
            assert float(rows[0][column] or "nan") == pytest.approx(value, abs=0.006, nan_ok=True)
    assert {rows[LOST.start][f"{name}_{what}"] for name in names for what in ("deg", "sigma_deg")} == {""}
    table = re.findall(r"<tr><td>([a-z ]+)</td><td[^>]*>([^<]+)</td>(?:<td>([^<]+)</td>)?</tr>", page)
    told = {angle: (left, right) for angle, left, right in table if "±" in left}
    assert told["knee flexion"][0] != told["knee flexion"][1] != ""
    assert told["trunk flexion"][1] == ""
    assert IsbSeries.of(made_up("quadruped").scene.persons[0]).joints == []


def test_sigmas_of_joint_angles_are_those_of_drawn_poses() -> None:
    """Of poses around a bent one, drawn with a covariance that is not diagonal; one that is not known has none."""
    movement = made_up("human")
    body, q = movement.scene.persons[0].body, movement.steps[1].estimates[0].q
    joints, rng = joints_of(body), np.random.default_rng(1)
    root = np.radians(0.3) * rng.normal(size=(body.dof, body.dof)) / np.sqrt(body.dof)
    poses = q + rng.normal(size=(4000, body.dof)) @ root.T
    turns = body.world_from_parameters(poses)[:, [segment.end for segment in body.segments], :3, :3]
    angles = np.concatenate([joint.of(turns) for joint in joints], axis=1)
    spread = np.degrees(np.std(np.unwrap(angles, axis=0), axis=0))
    _, (sigmas,) = angles_of(joints, body, q[None], (root @ root.T)[None])
    known = np.isfinite(sigmas) & np.isfinite(spread)
    assert known.sum() >= len(sigmas) - 4
    np.testing.assert_allclose(sigmas[known], spread[known], rtol=0.1)
    assert np.isnan(angles_of(joints, body, q[None], np.full((1, body.dof, body.dof), np.nan))[1]).all()


def test_angles_of_frames_together_are_those_of_each_frame() -> None:
    """To the last bit: rows do not depend on when they are computed."""
    movement = made_up("human")
    series, body = IsbSeries.of(movement.scene.persons[0]), movement.scene.persons[0].body
    for step in movement.steps:
        series.add(step, step.estimates[0])
    known = [step.estimates[0] for step in movement.steps if not step.estimates[0].lost]
    alone = [np.stack(angles_of(series.joints, body, e.q[None], e.covariance[None]), axis=1)[0] for e in known]
    found = series.values[[not step.estimates[0].lost for step in movement.steps]]
    np.testing.assert_array_equal(found, alone)


def test_the_report_shows_the_figure_that_plots_drew(tmp_path: Path) -> None:
    movement = made_up("human")
    context = movement.context(tmp_path)
    recorders = [recording.begin(context) for recording in (Report(player=False), Plots())]
    for step in movement.steps:
        for recorder in recorders:
            recorder.write(step)
    (plot,), (page,) = recorders[1].finish(), recorders[0].finish()
    assert base64.b64encode(plot.read_bytes()).decode() in page.read_text()


def test_somebody_lost_throughout_has_angles_without_a_number() -> None:
    movement = made_up("human")
    series = IsbSeries.of(movement.scene.persons[0])
    for step in movement.steps[LOST]:
        series.add(step, step.estimates[0])
    assert {row.left for row in series.rows()} == {"-"}
    assert len(series.figure().axes) == len(series.names) > 20


def test_a_smooth_result_has_a_report_and_an_overlay(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    movement = made_up("human")
    lost = replace(movement.steps[LOST.start].estimates[0], doubts=(Doubt("", Because.FEW_VIEWS, 1.0, 2.0),))
    steps = [replace(one, estimates=(lost,)) if one.estimates[0].lost else one for one in movement.steps]
    steps[0] = replace(steps[0], estimates=(in_doubt(steps[0].estimates[0], "left_arm"),))
    raw = tracker.load_result(replace(movement, steps=steps).result(tmp_path / "raw"))
    images = tuple(np.full((camera.size[1], camera.size[0], 3), 90, np.uint8) for camera in raw.rig.cameras)
    told: list[int] = []

    def frames() -> list[Frame]:
        """All but the last one, and one that the run has left out."""
        return [Frame(k, 99.0, images) for k in range(9, 9 + N_FRAMES)]

    pictures = Pictures((Report(), Overlay()), lambda: iter(frames()), lambda what, done=0, *more: told.append(done))
    folder = write_smoothed(raw, RauchTungStriebel(), tmp_path / "smooth", pictures=pictures)
    page = (folder / "report.html").read_text()
    assert "smoothed by rts" in page
    assert {"velocities.csv", "doubts.csv"} <= set(re.findall(r'href="([^":]+)"', page))
    assert (folder / "overlay.mp4").stat().st_size > 0
    assert told == list(range(1, N_FRAMES + 1))
    with (folder / "doubts.csv").open(newline="") as file:
        rows = [(row["frame"], row["limb"], row["because"]) for row in csv.DictReader(file)]
    filled = [(str(10 + t), "", "few_views") for t in range(LOST.start, LOST.stop)]
    assert rows == [("10", "left_arm", "left_over"), *filled]
    assert tracker.load_result(folder).persons[0].statuses[LOST] == ("filled",) * 3

    def gone() -> list[Frame]:
        raise SequenceError("a.mp4: no such file")

    folder = write_smoothed(raw, RauchTungStriebel(), tmp_path / "bare", pictures=Pictures((Report(), Overlay()), gone))
    assert (folder / "report.html").is_file()
    assert not (folder / "overlay.mp4").exists()
    assert "no overlay, and no images in the report: a.mp4: no such file" in caplog.text


@pytest.mark.skipif(PROGRAM is None, reason="no Chromium (apt-get install chromium)")
def test_a_telephone_shows_it_without_scrolling_sideways(tmp_path: Path) -> None:
    movement = doubted()
    name = "a" * 60
    page_of(movement, tmp_path, player=True)
    path = tmp_path / "report.html"
    path.write_text(path.read_text().replace("<h1>made_up", f"<h1>{name}"))
    with browser(tmp_path / "profile") as opened:
        opened._ask("Emulation.setDeviceMetricsOverride", width=420, height=900, deviceScaleFactor=1, mobile=True)
        opened.open(path.as_uri())
        opened.wait("document.getElementById('player')?.dataset.state == 'ready'")
        assert opened.value("document.documentElement.scrollWidth") <= 420
        opened.value("document.querySelectorAll('details').forEach((one) => (one.open = true))")
        assert opened.value("document.documentElement.scrollWidth") <= 420
        assert opened.errors == []
