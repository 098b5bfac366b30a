"""What a run leaves on disk, against the steps it was given."""

from __future__ import annotations

import csv
import json
import re
from base64 import b85encode
from dataclasses import replace

import av
import numpy as np
import pytest
from doubted import in_doubt
from hypothesis import given, settings
from hypothesis import strategies as st
from recordings import TrueStart, cycle_for, small_simulation

from tracker.bodies.body.description import load_body
from tracker.bodies.scene import Person
from tracker.evidence.measures.account import Account
from tracker.foundation.errors import SequenceError
from tracker.foundation.resources import model_path
from tracker.results.recording import RunContext
from tracker.results.recording._journal_line import covariance_of, kept, unpacked
from tracker.results.recording._series import AMBIGUOUS, Series, parameter_figure
from tracker.results.recording.csv_table import CsvTable
from tracker.results.recording.journal import FILE, Expected, Journal, as_kept, open_journal
from tracker.results.recording.overlay import Overlay
from tracker.results.recording.plots import Plots
from tracker.results.recording.report import Report
from tracker.results.recording.run_json import RunJson
from tracker.tracking.doubt import Because
from tracker.tracking.estimate import Estimate, Status
from tracker.tracking.sequence import track

N_FRAMES = 5


@pytest.fixture(scope="module")
def recorded():
    """Steps of a short run, a limb hidden in the second one, the third one lost, and their scene."""
    simulation = small_simulation(n_frames=N_FRAMES)
    steps = list(track(simulation.frames(), simulation.scene, cycle_for(simulation, TrueStart(simulation))))
    lost = tuple(replace(estimate, status=Status.LOST) for estimate in steps[2].estimates)
    steps[2] = replace(steps[2], estimates=lost)
    hidden = np.zeros((len(simulation.scene.rig), len(simulation.scene.shapes)), dtype=np.bool_)
    hidden[1, 3:5] = True
    seen = [replace(one, account=replace(one.account, hidden=hidden, not_shown=hidden)) for one in steps[1].estimates]
    steps[1] = replace(steps[1], estimates=tuple(seen))
    return simulation.scene, steps


def record(recording, recorded, folder, finish=True, **changes):
    scene, steps = recorded
    context = RunContext(name="test", folder=folder, scene=scene, fps=25.0, interval_s=0.04, n_frames=N_FRAMES)
    recorder = recording.begin(replace(context, **changes))
    for step in steps:
        recorder.write(step)
    if finish:
        recorder.finish()
    return recorder


def at_times(steps, times_s):
    """The steps as if their frames had been taken at other times."""
    return [replace(step, frame=replace(step.frame, time_s=t)) for step, t in zip(steps, times_s, strict=True)]


def rows_of(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def test_tables_hold_the_estimates_in_degrees_and_metres(recorded, tmp_path):
    record(CsvTable(), recorded, tmp_path)
    scene, steps = recorded
    body = scene.persons[0].body
    rows, sigmas = rows_of(tmp_path / "poses.csv"), rows_of(tmp_path / "sigmas.csv")
    assert list(rows[0])[:7] == ["frame", "time_s", "person", "status", "ambiguous", "distance_px", "torso_x_m"]
    assert list(rows[0]) == list(sigmas[0])
    for row, sigma, step in zip(rows, sigmas, steps, strict=True):
        estimate = step.estimates[0]
        assert (row["frame"], row["status"]) == (str(step.frame.index), str(estimate.verdict))
        cells = [row[parameter.column] for parameter in body.parameters]
        if estimate.lost:
            assert {*cells, row["distance_px"]} == {""}
            continue
        values = [
            float(cell) * (np.pi / 180 if p.rotates else 1) for cell, p in zip(cells, body.parameters, strict=True)
        ]
        np.testing.assert_allclose(values, estimate.q, atol=1e-5)
        assert float(sigma["torso_x_m"]) == pytest.approx(np.sqrt(estimate.covariance[0, 0]), abs=1e-5)
    joints = rows_of(tmp_path / "joints.csv")
    assert list(joints[0]) == ["frame", "time_s", "person", "joint", "x_m", "y_m", "z_m", "status", "sigma_m"]
    told = [float(row["sigma_m"]) for row in joints if row["frame"] == "0"]
    first_estimate = steps[0].estimates[0]
    np.testing.assert_allclose(told, body.landmark_sigmas(first_estimate.q, first_estimate.covariance), atol=1e-5)
    first = np.array([[float(row[axis]) for axis in ("x_m", "y_m", "z_m")] for row in joints if row["frame"] == "0"])
    np.testing.assert_allclose(first, body.landmarks_in_world(steps[0].estimates[0].q), atol=1e-5)
    assert {row["x_m"] for row in joints if row["frame"] == "2"} == {""}


def test_the_journal_is_exact(recorded, tmp_path):
    record(Journal(), recorded, tmp_path)
    journal = open_journal(tmp_path, Expected.of(recorded[0], start=0))
    assert (len(journal), journal.fault) == (N_FRAMES, "")
    for step in map(as_kept, recorded[1]):
        replay = journal[step.frame.index]
        for mine, theirs in zip(replay.estimates, step.estimates, strict=True):
            np.testing.assert_array_equal(mine.q, theirs.q)
            np.testing.assert_array_equal(mine.covariance, theirs.covariance)
            assert (mine.status, mine.distance_px) == (theirs.status, theirs.distance_px)
            for name in (
                "per_view_px",
                "per_part_px",
                "visible_px",
                "explained_px",
                "missed_px",
                "not_shown",
                "hidden",
            ):
                np.testing.assert_array_equal(getattr(mine.account, name), getattr(theirs.account, name))


def test_a_frame_of_one_person_takes_2_kb_in_the_journal(recorded, tmp_path):
    record(Journal(), recorded, tmp_path)
    assert (tmp_path / FILE).stat().st_size <= 1500 * N_FRAMES
    human = load_body(model_path("human"))
    rng = np.random.default_rng(0)
    # as many digits as there can be: with those measured it was a byte too much once, on a busy machine
    seconds = dict.fromkeys(recorded[1][0].seconds, 9.87654321)
    steps = [replace(step, estimates=(estimate_of(human, rng),), seconds=seconds) for step in recorded[1]]
    scene = replace(recorded[0], persons=(Person("anna", human, human.rest()),))
    record(Journal(), (scene, steps), tmp_path)
    assert (tmp_path / FILE).stat().st_size <= 2048 * N_FRAMES


def estimate_of(body, rng):
    """Numbers of many digits; the covariance is that of joints seen to 5 mm."""
    q = body.clamped(body.rest() + rng.normal(0, 0.2, body.dof))
    parameters = np.array([mark.parameter for mark in body.landmarks])
    slopes = body.point_jacobian(q, body.landmarks_in_world(q), parameters).reshape(-1, body.dof) / 0.005
    covariance = np.linalg.inv(slopes.T @ slopes + np.eye(body.dof))
    visible, missed = rng.uniform(10, 90, (2, len(body.parts)))
    visible[::6], missed[::2] = 0.0, 0.0
    account = Account(1 / 3, rng.random(4), rng.random(len(body.parts)), visible, visible - missed / 7, missed)
    return Estimate(q, covariance, account, 0.0, 1234, 0.0123456789)


def test_kept_covariances_are_the_estimates_but_for_rounded_correlations(recorded):
    for step in recorded[1]:
        before, after = step.estimates[0].covariance, as_kept(step).estimates[0].covariance
        np.testing.assert_allclose(np.diag(after), np.diag(before), rtol=2.0**-8)
        # variances of the combination of parameters that they tell most differently, over what they were
        ratios = np.linalg.eigvals(np.linalg.solve(before, after)).real
        assert 0.7 < ratios.min() <= ratios.max() < 1.4
        np.testing.assert_array_equal(as_kept(as_kept(step)).estimates[0].covariance, after)
    unknown = replace(recorded[1][0].estimates[0], covariance=np.full((22, 22), np.nan))
    kept = as_kept(replace(recorded[1][0], estimates=(unknown,))).estimates[0]
    assert np.isnan(kept.covariance).all()


@settings(max_examples=150, deadline=None, derandomize=True)
@given(st.integers(1, 40), st.integers(1, 60), st.floats(-18, 2), st.integers(0, 2**32 - 1))
def test_what_is_kept_of_any_covariance_is_one_and_is_kept_as_it_is(n, rank, floor, seed):
    rng = np.random.default_rng(seed)
    loose = rng.normal(size=(n, rank)) * 10 ** rng.uniform(-6, 3, (n, 1))
    covariance = loose @ loose.T + 10**floor * np.eye(n)
    if seed % 3 == 0:
        covariance[0] = covariance[:, 0] = 0.0
    after = covariance_of(kept(covariance))
    assert np.linalg.eigvalsh(after).min() >= -1e-9 * np.linalg.eigvalsh(after).max()
    np.testing.assert_allclose(np.diag(after), np.diag(covariance), rtol=2.0**-8)
    np.testing.assert_array_equal(covariance_of(kept(after)), after)
    np.testing.assert_array_equal(covariance_of(unpacked(*kept(after).packed())), after)


SPOILT = {
    "torn": lambda line: line[:40],
    "not text": lambda line: b"\xff\xfe\x00" + line,
    "not a journal's": lambda line: b'{"a": 1}\n',
    "of another model": lambda line: re.sub(rb'"q":"[^"]*"', b'"q":"' + b85encode(bytes(8 * 21)) + b'"', line),
    "out of order": lambda line: line.replace(b'"frame":2', b'"frame":1'),
    "of another stride": lambda line: line.replace(b'"frame":2', b'"frame":3'),
    "no numbers": lambda line: re.sub(
        rb'"q":"[^"]*"', b'"q":"' + b85encode(np.full(22, np.nan).tobytes()) + b'"', line
    ),
    "hidden elsewhere": lambda line: line.replace(b'"penalty_px"', b'"hidden":[[0,99]],"penalty_px"'),
    "brackets": lambda line: 100_000 * b"[" + b"\n",
    "an endless line": lambda line: b'"' + (1 << 21) * b"x" + b"\n",
}


@pytest.mark.parametrize("spoilt", SPOILT)
def test_the_journal_ends_before_the_first_line_that_is_not_its_own(spoilt, recorded, tmp_path):
    record(Journal(), recorded, tmp_path)
    lines = (tmp_path / FILE).read_bytes().splitlines(keepends=True)
    good = b"".join(lines[:2])
    (tmp_path / FILE).write_bytes(good + SPOILT[spoilt](lines[2]) + lines[3])
    expected = Expected.of(recorded[0], start=0)
    journal = open_journal(tmp_path, expected)
    assert (list(journal), journal.n_bytes) == ([0, 1], len(good))
    assert journal.fault.startswith("line 3 is damaged or of another run: ")
    record(Journal(), (recorded[0], recorded[1]), tmp_path, resumed=frozenset(journal))
    assert (tmp_path / FILE).read_bytes() == b"".join(lines)


def test_a_journal_of_something_else_is_refused_as_a_whole(recorded, tmp_path):
    (tmp_path / FILE).write_text('{"frame": 0, "q": [1.0]}\n')
    with pytest.raises(SequenceError, match=r"line 1 is damaged or of another run.*run without --resume"):
        open_journal(tmp_path)
    (tmp_path / FILE).write_text('{"frame": 0, "q": [1.')
    assert len(open_journal(tmp_path)) == 0


def n_playable(path):
    with av.open(str(path)) as container:
        return sum(1 for _ in container.decode(video=0))


def test_the_overlay_shows_every_frame(recorded, tmp_path):
    record(Overlay(width_px=320), recorded, tmp_path)
    assert n_playable(tmp_path / "overlay.mp4") == N_FRAMES


@pytest.mark.parametrize(
    ("times_s", "interval_s"),
    [
        ([0.0, 0.04, 0.08, 0.12, 0.16], 0.04),
        ([1.6, 1.68, 1.76, 1.84, 1.92], 0.08),
        ([0.0, 1001 / 30000, 2002 / 30000, 3003 / 30000, 4004 / 30000], 1001 / 30000),
        ([0.0, 0.01, 0.05, 0.30, 0.31], 0.04),
        ([0.0, 1e-5, 2e-5, 3e-5, 4e-5], 1e-5),
    ],
    ids=["25 fps", "stride 2 from frame 40", "29.97 fps", "uneven", "the fastest"],
)
def test_the_overlay_plays_at_the_speed_of_the_recording(recorded, tmp_path, times_s, interval_s):
    """Each picture is shown at the time its frame was taken, after the first one."""
    scene, steps = recorded
    record(Overlay(width_px=320), (scene, at_times(steps, times_s)), tmp_path, interval_s=interval_s)
    with av.open(str(tmp_path / "overlay.mp4")) as container:
        shown = [frame.time for frame in container.decode(video=0)]
        lasting_s = container.duration / av.time_base
    np.testing.assert_allclose(shown, np.array(times_s) - times_s[0], atol=min(1e-4, 0.2 * interval_s))
    assert lasting_s == pytest.approx(times_s[-1] - times_s[0] + interval_s, abs=2e-3)


def test_plots_stand_at_the_true_times(recorded):
    """A frame stands for the time half-way to its neighbours, however unevenly they lie."""
    scene, steps = recorded
    series = Series(scene)
    for step in at_times(steps, (0.0, 0.1, 0.2, 0.6, 0.7)):
        series.add(step)
    np.testing.assert_allclose(series.spans(), [(-0.05, 0.05), (0.05, 0.15), (0.15, 0.4), (0.4, 0.65), (0.65, 0.75)])
    axes = parameter_figure(series, 0).axes
    np.testing.assert_allclose(axes[0].lines[0].get_xdata(), series.times_s)
    shaded = [patch for patch in axes[0].patches if patch.get_width() > 0]
    assert [(p.get_x(), p.get_x() + p.get_width()) for p in shaded] == [pytest.approx((0.15, 0.4))]


def test_the_strip_of_time_shows_limbs_in_doubt_where_nothing_worse_is_told(recorded):
    """A run with a leg ambiguous in every frame had a strip of one blue."""
    scene, steps = recorded
    sure = replace(steps[0].estimates[0], status=Status.TRACKED, doubts=())
    arm = in_doubt(sure, "left_arm")
    states = (sure, arm, arm, in_doubt(arm, "left_arm", whole=True), replace(arm, status=Status.LOST), sure)
    series = Series(replace(scene, persons=scene.persons[:1]))
    for k, estimate in enumerate(states):
        series.add(replace(steps[0], frame=replace(steps[0].frame, index=k, time_s=0.04 * k), estimates=(estimate,)))
    ((_, runs),) = series.strips()
    assert [one.state for one in runs] == ["tracked", AMBIGUOUS, "doubtful", "lost", "tracked"]
    assert [one.share for one in runs] == pytest.approx([1 / 6, 2 / 6, 1 / 6, 1 / 6, 1 / 6])
    assert [(one.first, one.last) for one in runs] == [(0, 0), (1, 2), (3, 3), (4, 4), (5, 5)]
    assert (runs[0].why, runs[1].why) == ("", f"left arm: {Because.LEFT_OVER.phrase}")
    assert runs[2].why == f"whole body, left arm: {Because.LEFT_OVER.phrase}"


def test_the_overlay_of_a_killed_run_plays_but_for_its_last_frames(recorded, tmp_path):
    scene, steps = recorded
    timed = at_times(6 * steps, 0.04 * np.arange(6 * N_FRAMES))
    recorder = record(Overlay(width_px=320), (scene, timed), tmp_path, finish=False)
    killed = tmp_path / "killed.mp4"
    killed.write_bytes((tmp_path / "overlay.mp4").read_bytes())
    recorder.finish()
    assert n_playable(killed) >= 6 * N_FRAMES - 11


def test_the_report_is_one_file_without_references(recorded, tmp_path):
    record(Report(pictures=2), recorded, tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert not re.search(r"(src|href)=\"(?!data:)", page)
    assert page.count("data:image/") >= 4
    assert "LOST" not in page.split("<body>")[0]
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]


@pytest.mark.parametrize(("confidence", "told"), [(0.06, True), (0.5, False)])
def test_the_report_tells_of_a_start_that_is_rather_wrong(recorded, tmp_path, confidence, told):
    scene, steps = recorded
    begun = replace(steps[0], start=None, told_confidence=(confidence,))
    record(Report(player=False), (scene, [begun, steps[1]]), tmp_path)
    page = " ".join((tmp_path / "report.html").read_text().split())
    assert ("is more likely wrong than right (confidence 0.06)" in page) == told


def test_somebody_of_whom_a_view_shows_a_single_sample_is_pictured(recorded, tmp_path):
    """Who leaves a view is seen at its border for some frames: the report ended the run there."""
    scene, steps = recorded
    counts = steps[0].fitted.counts.copy()
    counts[:, 1] = 1
    alone = replace(steps[0], fitted=replace(steps[0].fitted, counts=counts))
    assert len(alone.fitted.of(1).parts) == 1
    record(Report(player=False), (scene, [alone]), tmp_path)
    assert "data:image/jpeg" in (tmp_path / "report.html").read_text()


def test_plots_are_drawn_for_each_person(recorded, tmp_path):
    record(Plots(), recorded, tmp_path)
    assert (tmp_path / "parameters.png").stat().st_size > 10_000


def test_run_json_tells_whether_the_run_is_complete(recorded, tmp_path):
    record(RunJson(), recorded, tmp_path, finish=False)
    assert '"complete": false' in (tmp_path / "run.json").read_text()
    record(RunJson(), recorded, tmp_path)
    text = (tmp_path / "run.json").read_text()
    assert '"complete": true' in text
    assert '"lost": 1' in text


def test_headline_numbers_are_of_the_poses_that_were_found(recorded, tmp_path):
    """A lost pose that is far off does not count; with nobody found there is no mean."""
    scene, steps = recorded
    far = replace(steps[2].estimates[0], penalty_px=1000.0)
    steps = [*steps[:2], replace(steps[2], estimates=(far,)), *steps[3:]]
    record(RunJson(), (scene, steps), tmp_path)
    found = [step.estimates[0] for step in steps if not step.estimates[0].lost]
    told = json.loads((tmp_path / "run.json").read_text())["summary"]
    assert told["mean_distance_px"] == pytest.approx(np.mean([one.distance_px for one in found]))
    assert told["mean_explained"] == pytest.approx(np.mean([one.account.explained for one in found]))
    for recording in (RunJson(), Report(pictures=1)):
        record(recording, (scene, at_times([steps[2]] * N_FRAMES, 0.04 * np.arange(N_FRAMES))), tmp_path)
    assert '"mean_distance_px": null' in (tmp_path / "run.json").read_text()
    assert "<b>-</b><span>mean distance" in (tmp_path / "report.html").read_text()
