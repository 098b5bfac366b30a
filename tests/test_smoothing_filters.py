"""Spline and low-pass filter: penalties, cut-offs, derivatives."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from motions import made_up
from scipy.interpolate import make_interp_spline, make_smoothing_spline
from swinging import FPS, observed, rms, swinging

import tracker
from tracker.foundation.errors import ConfigError
from tracker.results.smoothed_result import write_smoothed
from tracker.results.smoothing import LEAST_FRAMES, Stretch
from tracker.results.smoothing.butterworth import Butterworth
from tracker.results.smoothing.spline import Spline, _validated


@pytest.mark.parametrize("n", [LEAST_FRAMES, 9, 60])
def test_the_penalty_is_that_of_a_dense_cross_validation(n):
    """GCV with the smoother's matrix written out, over all penalties, at uneven times."""
    _, truth, _, _ = swinging(n=n, dof=4)
    times = np.cumsum(np.random.default_rng(2).uniform(0.6, 1.5, n))
    columns = observed(truth, 0.05).poses + 1.5 * times[:, None]
    penalties, errors = np.logspace(-4, 10, 57), []
    for penalty in penalties:
        smoother = make_smoothing_spline(times, np.eye(n), lam=penalty)(times)
        left = ((columns - smoother @ columns) ** 2).mean(axis=0)
        errors.append(left / (1 - np.trace(smoother) / n) ** 2)
    found = np.searchsorted(penalties, _validated(times, columns))
    least = np.take_along_axis(np.array(errors), found[None], axis=0)[0]
    np.testing.assert_allclose(
        least, np.min(errors, axis=0), rtol=1e-6
    )  # of straight lines many penalties are the best


def test_the_spline_smooths_who_walks_on_as_who_stands():
    """A straight line has no bends, so that it changes nothing of what is left of the noise."""
    still = observed(np.zeros((75, 1)), 0.005)
    line = 1.2 * still.times_s[:, None]
    left = [Spline().smooth([replace(still, poses=still.poses + one)])[0].poses - one for one in (0.0, line)]
    np.testing.assert_allclose(left[1], left[0], atol=1e-4)
    assert rms(left[1]) < 0.3 * 0.005


def test_velocities_of_the_spline_are_its_own():
    """A quintic one through the smooth poses has accelerations of tens at the ends, where there are none."""
    times = np.arange(60) / FPS
    truth = (2 * times**2)[:, None]
    (smooth,) = Spline().smooth([observed(truth, 0.01)])
    np.testing.assert_allclose(smooth.accelerations[[0, -1]], 0, atol=1e-9)
    between = make_interp_spline(times, smooth.poses, k=3, bc_type="natural")  # the cubic one through them is the same
    np.testing.assert_allclose(smooth.velocities, between(times, nu=1), atol=1e-6)


@pytest.mark.parametrize(("fps", "cutoff_hz"), [(100, 6), (25, 6), (25, 9), (50, 12)])
def test_the_filter_passes_half_the_power_at_its_cutoff(fps, cutoff_hz):
    """Also where the cut-off is near half the frame rate."""
    times = np.arange(1000) / fps
    for hz, share in ((cutoff_hz / 6, 1.0), (cutoff_hz - 0.01, np.sqrt(0.5)), (0.48 * fps, 0.0)):
        wave = np.sin(2 * np.pi * hz * times)[:, None]
        stretch = Stretch(times, wave, np.ones((1000, 1, 1)), np.ones(1000, bool))
        passed = Butterworth(cutoff_hz=cutoff_hz).smooth([stretch])[0].poses[200:-200]
        assert rms(passed) / rms(wave[200:-200]) == pytest.approx(share, abs=0.02)


def test_the_filter_takes_stretches_whose_frames_lie_far_apart():
    """Whether the cut-off fits is asked of the whole recording, and one stretch may have half as many frames."""
    times = np.arange(40) * 0.09
    wave = np.sin(times)[:, None]
    stretch = Stretch(times, wave, np.ones((40, 1, 1)), np.ones(40, bool))
    Butterworth(cutoff_hz=6).check(0.04)
    np.testing.assert_allclose(Butterworth(cutoff_hz=6).smooth([stretch])[0].poses, wave, atol=0.01)


def test_the_cutoff_must_lie_below_half_the_frame_rate(tmp_path):
    result = tracker.load_result(made_up("gavrila22").result(tmp_path))
    with pytest.raises(ConfigError, match=r"cutoff_hz = 13, expected 12\.49 at most at the frame rate of 25 Hz"):
        write_smoothed(result, Butterworth(cutoff_hz=13))
    assert not (tmp_path / "smoothed").exists()
    write_smoothed(result, Butterworth(cutoff_hz=12.49))
    for interval_s in (0.04, 0.01, 1 / 3):  # what is told is possible, half the frame rate itself is not
        with pytest.raises(ConfigError) as fault:
            Butterworth(cutoff_hz=0.5 / interval_s).check(interval_s)
        told_hz = float(re.search("expected (.*) at most", str(fault.value))[1])
        Butterworth(cutoff_hz=told_hz).check(interval_s)
