"""Smoothing: less jitter at no loss of accuracy, short gaps filled and marked, the raw result beside it."""

from __future__ import annotations

import csv
import functools
import logging
import signal
from dataclasses import replace

import numpy as np
import pytest
from motions import LOST, N_FRAMES, made_up
from recordings import TrueStart, cycle_for, small_simulation
from rounding import assert_alike
from swinging import FPS, observed, rms, swinging
from typer.testing import CliRunner

import tracker
from tracker.foundation.configuration.components import available, find
from tracker.foundation.errors import ConfigError
from tracker.results.smoothed_result import joint_motion, smooth_track, write_smoothed
from tracker.results.smoothing import LEAST_FRAMES, Stretch, stretches_of
from tracker.results.smoothing.butterworth import Butterworth
from tracker.results.smoothing.one_euro import OneEuro
from tracker.results.smoothing.rts import RauchTungStriebel, _likeliest
from tracker.results.smoothing.spline import Spline
from tracker.running.cli import app
from tracker.running.jobs import execute, load_job
from tracker.synthesis.simulation.sequence import Recipe, write_sequence
from tracker.tracking.estimate import Status
from tracker.tracking.sequence import track

every_smoothing = pytest.mark.parametrize("use", available("smoothing"))
WITHOUT_LAG = [RauchTungStriebel(), Butterworth(), Spline()]


def jitter(error, dt=1 / FPS):
    """Noise of the acceleration, from second differences."""
    return rms(np.diff(error, 2, axis=0) / dt**2)


@every_smoothing
def test_every_smoothing_takes_away_jitter(use):
    _, truth, _, _ = swinging()
    stretch = observed(truth)
    smooth = find("smoothing", use)().smooth([stretch])[0]
    assert {array.shape for array in (smooth.poses, smooth.velocities, smooth.accelerations)} == {truth.shape}
    assert jitter(smooth.poses - truth) < 0.7 * jitter(stretch.poses - truth)


@pytest.mark.parametrize("smoothing", WITHOUT_LAG, ids=lambda one: type(one).__name__)
def test_what_has_no_lag_comes_nearer_to_the_truth(smoothing):
    _, truth, velocities, accelerations = swinging()
    stretch, inner = observed(truth), slice(10, -10)
    smooth = smoothing.smooth([stretch])[0]
    assert rms(smooth.poses - truth) < 0.6 * rms(stretch.poses - truth)
    assert rms((smooth.velocities - velocities)[inner]) < 0.2 * rms(velocities)
    if isinstance(smoothing, RauchTungStriebel):  # jitter of 6 Hz and 0.01 has accelerations of 14, the truth of 8
        assert rms((smooth.accelerations - accelerations)[inner]) < 0.2 * rms(accelerations)


@every_smoothing
def test_short_gaps_are_filled(use):
    _, truth, _, _ = swinging()
    known = np.ones(len(truth), bool)
    known[[20, 21, 22, 60, 100, 101, 102, 103]] = False
    smooth = find("smoothing", use)().smooth([observed(truth, 1e-4, known=known)])[0]
    assert np.isfinite(smooth.poses).all()
    late = 0.2 if use == "one_euro" else 0.03
    assert np.abs(smooth.poses - truth)[~known].max() < late  # the truth moves by up to 0.35 there


@every_smoothing
def test_what_stands_still_stays(use):
    times = np.arange(40) / FPS
    poses, nothing = np.full((40, 2), 0.3), np.zeros((40, 2, 2))
    smooth = find("smoothing", use)().smooth([Stretch(times, poses, nothing, np.ones(40, bool))])[0]
    np.testing.assert_allclose(smooth.poses, poses, atol=1e-9)
    np.testing.assert_allclose(smooth.accelerations, 0, atol=1e-4)


@every_smoothing
def test_covariances_that_are_unknown_do_no_harm(use):
    _, truth, _, _ = swinging()
    stretch = observed(truth)
    unknown = replace(stretch, covariances=np.full_like(stretch.covariances, np.nan))
    smooth = find("smoothing", use)().smooth([unknown])[0]
    assert jitter(smooth.poses - truth) < 0.7 * jitter(stretch.poses - truth)


def test_the_smoother_finds_the_noises_that_made_the_movement():
    """Of a random walk of accelerations: jitter's share of the sigmas within 10 %, movement within two grid steps."""
    rng, h, n = np.random.default_rng(3), 1 / FPS, 2000
    movement, sigma = 0.2, 0.01  # rad2/s5, rad
    state, truth = np.zeros(3), []
    added = movement * np.array(
        [[h**5 / 20, h**4 / 8, h**3 / 6], [h**4 / 8, h**3 / 3, h**2 / 2], [h**3 / 6, h**2 / 2, h]]
    )
    root = np.linalg.cholesky(added)
    for _ in range(n):
        state = np.array([[1, h, h * h / 2], [0, 1, h], [0, 0, 1]]) @ state + root @ rng.normal(size=3)
        truth.append(state[:1])
    stretch = observed(np.array(truth), sigma)
    told = replace(stretch, covariances=4 * stretch.covariances)  # says twice the sigma
    noise = _likeliest([told])
    assert noise.shares[0] == pytest.approx(0.5, rel=0.1)
    assert 0.1 < noise.movement[0] / (movement * h**5) < 10


def test_the_smoother_is_the_least_squares_solution():
    """Against a dense solve of the same problem: all states at once, a parameter hidden at times."""
    _, truth, _, _ = swinging(n=30, dof=2)
    known = np.arange(30) != 12
    stretch = observed(truth, known=known)
    tilt = np.array([[1.0, 0.8], [0.8, 1.0]])
    spread = np.where(np.arange(30)[:, None, None] % 5 == 0, 100 * np.diag([1.0, 0.01]), tilt)
    stretch = replace(stretch, covariances=4e-4 * spread)
    noise = _likeliest([stretch])
    smooth = RauchTungStriebel().smooth([stretch])[0]
    np.testing.assert_allclose(smooth.poses, dense(stretch, noise), atol=1e-7)


def test_long_stretches_are_smoothed_in_pieces_to_the_same_result(monkeypatch):
    _, truth, _, _ = swinging(n=90, dof=2)
    stretch = observed(truth, known=(np.arange(90) % 11 != 5))
    whole = RauchTungStriebel().smooth([stretch])[0]
    for chunk in (1, 30, 89, 90, 91):
        monkeypatch.setattr("tracker.results.smoothing.rts._CHUNK", chunk)
        pieces = RauchTungStriebel().smooth([stretch])[0]
        for name in ("poses", "velocities", "accelerations", "covariances"):
            assert_alike(getattr(pieces, name), getattr(whole, name))


def dense(stretch, noise):
    """Minimizes the squared residuals of poses and of movement over all states."""
    n, dof = stretch.poses.shape
    size, h = 3 * dof, noise.interval_s
    fastest = np.repeat([30.0 * h, 1000.0 * h * h], dof)
    matrix, right = np.zeros((n * size, n * size)), np.zeros(n * size)
    matrix[dof:size, dof:size] += np.diag(fastest**-2)
    moved = np.kron([[1, 1, 0.5], [0, 1, 1], [0, 0, 1]], np.eye(dof))
    added = np.array([[1 / 20, 1 / 8, 1 / 6], [1 / 8, 1 / 3, 1 / 2], [1 / 6, 1 / 2, 1]])
    weight = np.linalg.inv(np.kron(added, np.diag(noise.movement)))
    jitter = noise.jitter(stretch.covariances + 1e-10 * np.eye(dof))
    for t in range(n):
        here = slice(t * size, t * size + dof)
        if stretch.known[t]:
            matrix[here, here] += np.linalg.inv(jitter[t])
            right[here] += np.linalg.inv(jitter[t]) @ stretch.poses[t]
        if t:
            both = slice((t - 1) * size, (t + 1) * size)
            change = np.hstack([-moved, np.eye(size)])
            matrix[both, both] += change.T @ weight @ change
    return np.linalg.solve(matrix, right).reshape(n, size)[:, :dof]


def test_smooth_sigmas_are_those_of_the_whole_error():
    """Told sigmas hold jitter and a slow error in equal parts: smoothing must not claim to have cured the slow one."""
    rng = np.random.default_rng(5)
    _, truth, _, _ = swinging(n=400, dof=6)
    slow = 0.02 * np.ones((400, 1)) * rng.normal(size=6)
    stretch = observed(truth, 0.02)
    stretch = replace(stretch, poses=stretch.poses + slow, covariances=2 * stretch.covariances)
    smooth = RauchTungStriebel().smooth([stretch])[0]
    sigmas = np.sqrt(np.diagonal(smooth.covariances, axis1=1, axis2=2))
    assert (sigmas < np.sqrt(2) * 0.02).all()
    assert 0.8 < np.median(sigmas) / 0.02 < 1.2  # the slow error's
    assert rms((smooth.poses - truth) / sigmas) < 1.6


def test_a_higher_beta_lags_less():
    _, truth, _, _ = swinging()
    stretch = observed(truth, 1e-4)
    lags = [rms(OneEuro(beta=beta).smooth([stretch])[0].poses - truth) for beta in (0, 5, 50)]
    assert lags[0] > lags[1] > lags[2]


def test_stretches_end_at_long_gaps():
    known = np.ones(40, bool)
    known[[0, 12, 13, 14, 25, 26, 27, 28, 39]] = False
    times = 0.04 * np.arange(40)
    wanted = [slice(1, 25), slice(29, 39)]
    assert stretches_of(times, known, 0.04, 0.12) == wanted
    assert stretches_of(times, known, 0.04, 0.11) == [slice(1, 12), slice(15, 25), slice(29, 39)]
    assert stretches_of(times, known, 0.04, 0.16) == [slice(1, 39)]
    times[20:] += 0.5  # frames that are not there at all are a gap, too
    assert stretches_of(times, known, 0.04, 0.16) == [slice(1, 20), slice(20, 39)]
    assert stretches_of(times[:LEAST_FRAMES], known[:LEAST_FRAMES], 0.04, 1.0) == []
    assert stretches_of(times, np.zeros(40, bool), 0.04, 1.0) == []


# Results


def statuses(folder, name="poses.csv"):
    with (folder / name).open(newline="") as file:
        return [row["status"] for row in csv.DictReader(file) if row["person"] == "person1"]


@every_smoothing
def test_a_smooth_result_lies_beside_the_raw_one(use, tmp_path):
    raw = tracker.load_result(made_up("human", "quadruped").result(tmp_path / "result"))
    before = (tmp_path / "result" / "steps.jsonl").read_bytes()
    folder = write_smoothed(raw, find("smoothing", use)())
    assert folder == tmp_path / "result" / "smoothed"
    assert (tmp_path / "result" / "steps.jsonl").read_bytes() == before
    smooth = tracker.load_result(folder)
    assert smooth.details["smoothing"]["use"] == use
    person = smooth.persons[0]
    assert person.statuses == ("tracked",) * LOST.start + ("filled",) * 3 + ("tracked",) * (N_FRAMES - LOST.stop)
    assert statuses(folder) == statuses(folder, "velocities.csv") == list(person.statuses)
    assert np.isfinite(person.poses).all()
    assert (np.abs(np.diff(person.poses, axis=0)) < 1.5).all()  # no turn lost or won
    limits = person.body.limits
    assert ((person.poses >= limits[:, 0]) & (person.poses <= limits[:, 1])).all()


def test_long_gaps_stay_lost_and_are_said(tmp_path, caplog):
    raw = tracker.load_result(made_up("gavrila22").result(tmp_path))
    with caplog.at_level(logging.WARNING, "tracker"):
        folder = write_smoothed(raw, RauchTungStriebel(max_gap_s=0.08))
    smooth = tracker.load_result(folder)
    assert smooth.persons[0].statuses == raw.persons[0].statuses
    np.testing.assert_array_equal(smooth.persons[0].poses, raw.persons[0].poses)  # 4 and 5 frames are too few
    assert "9 frames between long gaps are too few" in caplog.text


def test_joints_move_as_their_places_do(tmp_path):
    """Against the Jacobian: v = J(q) q', and the differences of v along the movement."""
    raw = tracker.load_result(made_up("human").result(tmp_path)).persons[0]
    smooth = smooth_track(raw, RauchTungStriebel(), 0.04)
    moved = replace(raw, estimates=smooth.estimates)
    velocities, accelerations = joint_motion(moved, smooth)
    assert velocities.shape == accelerations.shape == moved.joints.shape
    body, h = raw.body, 1e-5
    ends = np.array([body.landmarks[mark].parameter for mark in body.reported])
    for t in (0, 5, 11):
        q, rate, change = smooth.estimates[t].q, smooth.velocities[t], smooth.accelerations[t]
        near = []
        for dt in (-h, 0, h):
            there = q + dt * rate + dt**2 / 2 * change
            places = body.landmarks_in_world(there)[list(body.reported)]
            near.append(body.point_jacobian(there, places, ends) @ (rate + dt * change))
        np.testing.assert_allclose(velocities[t], near[1], atol=1e-4)
        np.testing.assert_allclose(accelerations[t], (near[2] - near[0]) / (2 * h), atol=1e-2)


def test_the_command_smooths_and_the_result_is_exported(tmp_path):
    result = made_up("gavrila22", "gavrila22").result(tmp_path / "result")
    told = CliRunner().invoke(app, ["result", "smooth", str(result), "--use", "butterworth", "--set", "cutoff_hz=8"])
    assert told.exit_code == 0, told.output
    assert told.output.splitlines()[-3:] == [
        "person1: 12 frames, 3 filled, 0 still lost",
        "person2: 12 frames, 0 filled, 0 still lost",
        str(result / "smoothed"),
    ]
    assert tracker.load_result(result / "smoothed").details["smoothing"]["cutoff_hz"] == 8
    assert "smoothed by butterworth" in (result / "smoothed" / "report.html").read_text()
    again = CliRunner().invoke(app, ["result", "smooth", str(result)])
    assert isinstance(again.exception, ConfigError)
    assert "smoothed is not empty: choose another --output" in str(again.exception)
    told = CliRunner().invoke(app, ["result", "export", str(result / "smoothed"), "--to", "trc", "mot"])
    assert told.exit_code == 0, told.output
    assert "NaN" not in (result / "smoothed" / "exports" / "person1.trc").read_text()
    wrong = CliRunner().invoke(app, ["result", "smooth", str(result), "--use", "butterwort"])
    assert 'did you mean "butterworth"' in str(wrong.exception)


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    folder = tmp_path_factory.mktemp("smoothing") / "sequence"
    path = write_sequence(Recipe("arm_swing", seconds=0.4, size=(360, 288)), folder)
    start = ["initialization.use=given", "initialization.poses=truth_poses.csv", "persons.0.shape=model"]
    outputs = "recordings=[{use='csv_table'},{use='journal'},{use='run_json'}]"
    return path, [*start, outputs, "smoothing=rts", "evidence=contours", "reading.downscale=1"]


def test_a_run_smooths_at_its_end_and_again_when_resumed(config, tmp_path):
    path, overrides = config
    outcome = execute(load_job("track", path, overrides), tmp_path / "out")
    assert outcome.files[-1] == tmp_path / "out" / "smoothed"
    wanted = tracker.load_result(tmp_path / "out" / "smoothed").persons[0].poses

    def interrupt(what, done=0, total=0, detail=""):
        if what == "tracking" and done == 9:
            raise KeyboardInterrupt

    execute(load_job("track", path, overrides), tmp_path / "halves", progress=interrupt)
    assert len(tracker.load_result(tmp_path / "halves" / "smoothed").frames) == 9
    execute(load_job("track", path, overrides), tmp_path / "halves", resume=True)
    found = tracker.load_result(tmp_path / "halves" / "smoothed")
    assert len(found.frames) == 10
    np.testing.assert_array_equal(found.persons[0].poses, wanted)


def test_a_run_that_is_stopped_in_its_first_window_has_nothing_to_smooth_yet(config, tmp_path):
    """Its tables have what the first pass has found, its journal has nothing before the second."""
    path, more = config
    overrides = [*more, "reading.stop=4"]

    def stop(what, done=0, total=0, detail=""):
        if what.startswith("forwards: frame 1,"):
            signal.raise_signal(signal.SIGINT)

    outcome = execute(load_job("track", path, overrides), tmp_path / "out", progress=stop)
    assert (outcome.interrupted, (tmp_path / "out" / "smoothed").exists()) == (True, False)
    assert 0 < outcome.n_frames < 4
    with pytest.raises(ConfigError, match="no frame is kept yet of this run, see its tables, or go on with"):
        tracker.load_result(tmp_path / "out")


def test_what_a_smoothing_cannot_do_is_said_before_the_first_frame(config, tmp_path):
    path, overrides = config
    for more, words in (
        (["smoothing.use=butterworth", "smoothing.cutoff_hz=13"], "cutoff_hz = 13, expected 12.49 at most"),
        (['recordings=["csv_table"]'], "smoothing needs the recordings journal and run_json; add journal, run_json"),
    ):
        job = load_job(
            "track",
            path,
            [*overrides[:2], *(more if "smoothing.use=butterworth" in more else ["smoothing=rts", *more])],
        )
        with pytest.raises(ConfigError, match=words):
            execute(job, tmp_path / "out")
        assert not (tmp_path / "out").exists()


# Against the simulations' truth


@functools.cache
def tracked(movement):
    """A simulated movement of two seconds, its tracked poses as a stretch, and the truth."""
    simulation = small_simulation(movement, 50)
    steps = list(track(simulation.frames(), simulation.scene, cycle_for(simulation, TrueStart(simulation))))
    estimates = [step.estimates[0] for step in steps]
    assert all(estimate.status is not Status.LOST for estimate in estimates)
    poses, covariances = np.array([e.q for e in estimates]), np.array([e.covariance for e in estimates])
    return simulation, Stretch(np.arange(50) / 25, poses, covariances, np.ones(50, bool))


@pytest.mark.parametrize("smoothing", WITHOUT_LAG, ids=lambda one: type(one).__name__)
@pytest.mark.parametrize("movement", ["squat", "arm_swing"])
def test_jitter_of_tracked_movements_falls_and_accuracy_does_not(movement, smoothing):
    """Noise of the joints' accelerations down by 30 % at least, RMS distance to the true joints not up."""
    simulation, stretch = tracked(movement)
    body, truth = simulation.scene.persons[0].body, simulation.poses[0]
    smooth = body.clamped(smoothing.smooth([stretch])[0].poses)
    raw, less = (body.landmarks_in_world(q) - body.landmarks_in_world(truth) for q in (stretch.poses, smooth))
    assert jitter(less, 0.04) < 0.7 * jitter(raw, 0.04)
    assert rms(less) <= rms(raw)
