"""Surfaces of pictures that others have published, with a truth or without."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tracker.points.surfaces.surface import measure_surface, residual_rms_px
from tracker.running.jobs import load_job

CONFIGS = Path(__file__).parents[1] / "configs" / "surfaces"


def test_a_real_triplet_is_measured(data):
    data("temple")
    run = load_job("surface", CONFIGS / "temple.toml", ("growth.step_px=4",))
    sequence = run.reading.open()
    surface = measure_surface(run, next(iter(sequence.frames())), sequence.rig)
    assert len(surface.points) > 1000
    assert residual_rms_px(surface.points) < 0.08


def test_a_real_pair_has_the_true_disparities(data):
    folder = data("stereo_gt/motorcycle")
    run = load_job("surface", CONFIGS / "motorcycle.toml", ("growth.step_px=6",))
    sequence = run.reading.open()
    points = measure_surface(run, next(iter(sequence.frames())), sequence.rig).points
    left, right = points.pixels
    columns, rows = left.astype(int).T
    errors = (left - right)[:, 0] - np.load(folder / "motorcycle_disp.npz")["arr_0"][rows, columns]
    errors = errors[np.isfinite(errors)]
    assert len(errors) > 3000
    assert np.median(np.abs(errors)) < 0.10
