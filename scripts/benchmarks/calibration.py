"""Calibration from scratch with a reference bar: convergence, precision beside the true calibration's, time."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.bars import SIZE, BarRecording, Faults, every, four_around, three_in_line, wave
from tracker.cameras.calibration.reference_bar import BarImages, ReferenceBarCalibration
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.errors import CalibrationError
from tracker.foundation.geometry import rigid_motion

Arrangement = tuple[str, Callable[[np.random.Generator], Rig], float, float]
"""Name, maker of the rig, length of the bar in metres, and the ratio to reach."""

# Those that LSMTA, section 2.1, and a usual studio have.
_ARRANGEMENTS: tuple[Arrangement, ...] = (
    ("three in line", three_in_line, 0.6, 1.06),
    ("four around", four_around, 1.0, 1.12),
)
# Centres of targets are good to 0.05 to 0.1 px; the interior is begun with a tenth off.
_NOISES_PX = (0.05, 0.1)
_FOCAL_OFF = 0.1


@dataclass(frozen=True)
class _Run:
    """One simulated recording calibrated from scratch."""

    seconds: float
    s0: float
    held_out_mm: float
    floor_mm: float
    position_mm: float
    """RMS error of the projection centres after alignment."""

    honesty: float
    """RMS of the errors of all interior parameters over their standard errors."""


def compare(console: Console, quick: bool) -> None:
    """Prints a row for each arrangement and noise."""
    n_runs, n_bars = (3, 60) if quick else (50, 200)
    table = Table(
        title=f"reference bar, {n_bars} bars, {SIZE[0]}x{SIZE[1]}, {n_runs} seeds, 5 % outliers, 5 % swapped ends, "
        f"focal lengths off by up to {100 * _FOCAL_OFF:.0f} %",
        title_justify="left",
    )
    for column in ("rig", "noise px", "converged", "s0", "hold-out bar RMS mm", "true calibration mm", "ratio", "aim"):
        table.add_column(column, justify="left" if column == "rig" else "right")
    for column in ("centres mm", "error / sigma", "CPU ms median", "95 %"):
        table.add_column(column, justify="right")
    _calibrated(_ARRANGEMENTS[0], 0.1, 0, 60)  # compiles the kernels
    for arrangement in _ARRANGEMENTS:
        for noise in _NOISES_PX:
            with console.status(f"{arrangement[0]}, {noise} px"):
                runs = [_calibrated(arrangement, noise, seed, n_bars) for seed in range(n_runs)]
            table.add_row(*_row(arrangement, noise, runs))
    console.print(table)
    console.print(
        "hold-out: other bars of the same waving, without gross errors, triangulated; ratio: RMS over all runs with "
        "the calibrated rigs over that with the true ones; error / sigma: interior parameters",
        style="dim",
    )


def _calibrated(arrangement: Arrangement, noise: float, seed: int, n_bars: int) -> _Run | None:
    """A calibration from scratch; None if it failed or ended elsewhere."""
    _, build, length, _ = arrangement
    rng = np.random.default_rng(seed)
    rig = build(rng)
    path_seed = int(rng.integers(2**32))
    recording = every(wave(rig, 2 * n_bars, length, np.random.default_rng(path_seed), Faults(noise, stride=5)), 0, 2)
    clean = Faults(noise, 0.0, 0.0, stride=5)
    held_out = every(wave(rig, 2 * n_bars, length, np.random.default_rng(path_seed), clean), 1, 2)
    focal = {camera.name: camera.matrix[1, 1] * (1 + rng.uniform(-_FOCAL_OFF, _FOCAL_OFF)) for camera in rig.cameras}
    images = BarImages(rig.names, (SIZE,) * len(rig), recording.frames, recording.pixels)
    component = ReferenceBarCalibration(length_m=length, focal_px=focal, sigma_px=noise)
    begin = time.process_time()
    try:
        adjustment, _ = component.adjusted(images)
    except CalibrationError:
        return None
    seconds = time.process_time() - begin
    found = Rig(adjustment.cameras)
    position = _position_error(found, rig)
    if position > 0.2:
        return None
    return _Run(
        seconds=seconds,
        s0=adjustment.s0,
        held_out_mm=_bar_rms(found, held_out),
        floor_mm=_bar_rms(rig, held_out),
        position_mm=1000 * position,
        honesty=_honesty(adjustment.cameras, rig, adjustment.sigmas, adjustment.free),
    )


def _bar_rms(rig: Rig, recording: BarRecording) -> float:
    """RMS error of the bars' lengths, mm."""
    points, _ = rig.triangulate(recording.pixels.reshape(len(rig), -1, 2))
    ends = points.reshape(-1, 2, 3)
    errors = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) - recording.length_m
    return 1000 * float(np.sqrt(np.nanmean(errors**2)))


def _position_error(found: Rig, truth: Rig) -> float:
    """RMS distance of the projection centres after the best rotation and shift, metres."""
    ours, theirs = (np.stack([camera.centre for camera in rig.cameras]) for rig in (found, truth))
    motion = rigid_motion(ours, theirs)
    return float(np.sqrt(np.mean(np.sum((ours @ motion[:3, :3].T + motion[:3, 3] - theirs) ** 2, axis=1))))


def _honesty(cameras: tuple[Camera, ...], truth: Rig, sigmas: Array, free: Mask) -> float:
    """RMS error of the interior parameters in their standard errors."""
    ratios = []
    for v, (found, true) in enumerate(zip(cameras, truth.cameras, strict=True)):
        known = free[v, 6:16]
        ratios.append((_interior(found) - _interior(true))[known] / sigmas[v, 6:16][known])
    return float(np.sqrt(np.mean(np.concatenate(ratios) ** 2)))


def _interior(camera: Camera) -> Array:
    """(10,) camera constant, principal point, affinity, shear, k1 k2 p1 p2 k3."""
    matrix = camera.matrix
    c = matrix[1, 1]
    return np.array([c, matrix[0, 2], matrix[1, 2], matrix[0, 0] / c - 1, matrix[0, 1] / c, *camera.distortion[:5]])


def _row(arrangement: Arrangement, noise: float, runs: list[_Run | None]) -> list[str]:
    good = [run for run in runs if run is not None]
    name, _, _, aim = arrangement
    if not good:
        return [name, f"{noise:g}", f"0 of {len(runs)}", *["-"] * 9]
    s0 = np.array([run.s0 for run in good])
    held_out, floor = np.sqrt(np.mean(np.square([(run.held_out_mm, run.floor_mm) for run in good]), axis=0))
    ratio = held_out / floor
    times = 1000 * np.array([run.seconds for run in good])
    return [
        name,
        f"{noise:g}",
        f"{len(good)} of {len(runs)}",
        f"{s0.mean():.3f} ({s0.min():.2f} to {s0.max():.2f})",
        f"{held_out:.3f}",
        f"{floor:.3f}",
        f"[{'green' if ratio <= aim else 'red'}]{ratio:.3f}[/]",
        f"{aim:.2f}",
        f"{np.mean([run.position_mm for run in good]):.2f}",
        f"{np.sqrt(np.mean(np.square([run.honesty for run in good]))):.2f}",
        f"{np.median(times):.0f}",
        f"{np.quantile(times, 0.95):.0f}",
    ]
