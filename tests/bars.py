"""Simulated bars for the tests of calibration."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from tracker.cameras.calibration._bundle import Observations, State
from tracker.cameras.calibration._objects import Bars, state_of
from tracker.cameras.calibration._start import bar_observations
from tracker.cameras.calibration.reference_bar import BarImages, ReferenceBarCalibration
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Mask
from tracker.kernels.rows import BundleUnknowns

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))
from benchmarks.bars import SIZE, BarRecording, Faults, four_around, three_in_line, wave

CLEAN = Faults(0.1, 0.0, 0.0)
LENGTH_M = 0.8


def recorded(seed: int = 0, n_bars: int = 60, faults: Faults = CLEAN, around: bool = True) -> BarRecording:
    rng = np.random.default_rng(seed)
    rig = four_around(rng) if around else three_in_line(rng)
    return wave(rig, n_bars, LENGTH_M, rng, faults)


def images_of(recording: BarRecording) -> BarImages:
    names = recording.rig.names
    return BarImages(names, (SIZE,) * len(names), recording.frames, np.array(recording.pixels))


def calibration(**fields: Any) -> ReferenceBarCalibration:
    return ReferenceBarCalibration(**{"length_m": LENGTH_M, "focal_px": 900.0, **fields})


def at_truth(recording: BarRecording, rig: Rig | None = None) -> tuple[State, Observations]:
    """State and observations of the true cameras and bars."""
    cameras = np.stack([state_of(camera) for camera in (rig or recording.rig).cameras])
    bars = Bars(np.array(recording.ends), LENGTH_M, 1e-4)
    return State(cameras, bars), bar_observations(recording.pixels, np.zeros_like(recording.pixels))


def all_but_offsets(n_cameras: int) -> Mask:
    free = np.ones((n_cameras, BundleUnknowns.N_UNKNOWNS), dtype=np.bool_)
    free[:, 16] = False
    return free
