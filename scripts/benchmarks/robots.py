"""Robots of public descriptions, simulated and tracked from their true first pose: our way, and the way of M3T.

M3T (Stoiber et al., A Multi-body Tracking Framework, CVPR workshops 2022) moves an exact model from where it was in the
frame before by colours on lines across its contours: no prediction, no limits, no search. Its own program is not at
hand here; `as M3T` are our own components set to work like that.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.trial import LIMB_MM, Outcome, default_cycle, tracked
from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import read_description
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.evidence.regions import RegionEvidence
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.tables import read_config
from tracker.images.plate import Plate
from tracker.running.jobs.acquire import acquire_to, acquisition_from
from tracker.synthesis.simulation.sequence import Recipe, simulate
from tracker.tracking.cycle import Cycle
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.loss import LossRule
from tracker.tracking.prediction.polynomial import PolynomialPrediction

_RATES = 25.0, 12.5
"""Frames a second: those at which M3T's own program held a walking person, and lost him."""

_AWAY = 2.2
"""Distance of the cameras, in sizes of the robot: it is some 300 px high in an image of 640x480."""

_NEAREST_M = 0.9
"""Distance of the cameras from a small robot at least."""

_COLUMNS = ("frames", "lost", "joints mean mm", "worst frame mm", "angles RMS deg, worst first", "ms a frame")


def compare(console: Console, files: list[Path], free: tuple[str, ...], quick: bool) -> None:
    """Prints how both ways follow each robot at two frame rates.

    Args:
        console: where to.
        files: URDF or MJCF.
        free: names of those, without suffix, whose base moves about.
        quick: small images and few frames, to see that it runs.
    """
    table = Table(title="simulated, true start pose, exact model, no plates for M3T's way", title_justify="left")
    for name in ("robot", "frames a second", "way", *_COLUMNS):
        table.add_column(name, no_wrap=True)
    with tempfile.TemporaryDirectory() as folder:
        for file in files:
            model = _acquired(file, file.stem in free, Path(folder))
            for fps in _RATES:
                with console.status(f"{file.stem}, {fps:g} frames a second"):
                    for way, outcome in _tracked(model, fps, quick).items():
                        table.add_row(file.stem, f"{fps:g}", way, *_cells(outcome))
    console.print(table)


def _acquired(file: Path, free: bool, folder: Path) -> Path:
    """The model file made of a description, in a folder."""
    config, base = folder / f"{file.stem}.config.toml", "free" if free else "fixed"
    config.write_text(f"[robot]\nfile = '{file.resolve()}'\nbase = '{base}'\n", encoding="utf-8")
    target = folder / f"{file.stem}.toml"
    acquire_to(acquisition_from(read_config(config, []), config.name, folder, file.stem), target)
    return target


def _tracked(model: Path, fps: float, quick: bool) -> dict[str, Outcome]:
    """Way -> the robot followed through the first movement that its file tells."""
    size, seconds = ((320, 240), 0.4) if quick else ((640, 480), 2.0)
    rig = _rig(read_description(model).build(), size)
    simulation = simulate(Recipe(model=str(model), seconds=seconds, fps=fps, size=size, rig=rig))
    truth, frames = simulation.poses[0], list(simulation.frames())
    ways = {"ours": simulation.plates, "ours, no plates": (None,) * len(rig)}
    cycles = {way: default_cycle(truth[0], plates, recovers=False) for way, plates in ways.items()}
    cycles["as M3T"] = _as_m3t(truth[0], len(rig))
    return {way: tracked(frames, simulation.scene, truth, cycle) for way, cycle in cycles.items()}


def _as_m3t(start: Array, n_views: int) -> Cycle:
    """Lines across contours and a refinement from the pose before, and nothing else; seven steps, as it has."""
    plates: tuple[Plate | None, ...] = (None,) * n_views
    return replace(
        default_cycle(start, plates, recovers=False),
        evidence=RegionEvidence(),
        prediction=PolynomialPrediction(degree=0),
        estimation=TwistIcpEstimation(iterations=7),
        loss=LossRule(lost_below=0.0, least_views=0),  # it tells of no loss
    )


def _rig(body: BodyModel, size: tuple[int, int]) -> Rig:
    """Four cameras around a robot at rest."""
    marks = body.landmarks_in_world(body.rest())
    middle, extent = (marks.max(axis=0) + marks.min(axis=0)) / 2, float(np.ptp(marks, axis=0).max())
    if not body.stays:  # it stands in the middle of the room
        middle = np.array([0.0, 0.0, middle[2] - marks[:, 2].min()])
    away_m, focal_px = max(_AWAY * extent, _NEAREST_M), 1.1 * size[0]
    cameras = []
    for k, azimuth in enumerate(np.radians((45.0, 135.0, 225.0, 315.0))):
        side = away_m * np.array([np.cos(azimuth), np.sin(azimuth), 0.5])
        place = middle + side
        cameras.append(Camera.looking_at(f"CAM{k + 1}", size, focal_px, (place[0], place[1], place[2]), middle))
    return Rig(tuple(cameras))


def _cells(outcome: Outcome) -> list[str]:
    kept = ~outcome.lost
    if not kept.any():
        return [str(len(kept)), str(len(kept)), *["-"] * (len(_COLUMNS) - 2)]
    joints = outcome.joints_mm[kept]
    body, errors = outcome.body, (outcome.poses - outcome.truth)[kept]
    turns = np.degrees(np.sqrt(np.mean(errors**2, axis=0)))[body.rotates]
    told = ", ".join(f"{value:.2f}" for value in np.sort(turns)[::-1][:4])
    off = int((joints.max(axis=1) > LIMB_MM).sum())
    worst = f"{joints.mean(axis=1).max():.1f}" + (f", {off} with a joint off" if off else "")
    ms = 1000 * float(np.median(outcome.cpu_s[1:]))
    return [str(len(kept)), str(int(outcome.lost.sum())), f"{joints.mean():.2f}", worst, told, f"{ms:.0f}"]
