"""How long a start takes where part of the background is known: in threads, beside the same in a loop."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from rich.console import Console
from rich.table import Table

from tracker.arrays import Array
from tracker.cycle import Cycle
from tracker.estimation.hybrid import HybridEstimation
from tracker.evidence.auto import AutoEvidence
from tracker.frame import Frame
from tracker.initialization.pca import PcaInitialization
from tracker.loss import LossRule
from tracker.plate import Plate
from tracker.prediction.polynomial import PolynomialPrediction
from tracker.rehearsal import rehearsed
from tracker.scene import Scene
from tracker.simulation.sequence import Recipe, simulate
from tracker.synthesis.cpu import CpuSynthesis


def compare(console: Console, quick: bool) -> None:
    """Prints wall and processor times of a start with its rehearsal, and whether both ways find the same pose."""
    size, n_frames = ((240, 192), 2) if quick else ((720, 576), 11)
    simulation = simulate(
        Recipe("two_elbow_rotation", "gavrila22" if quick else "human", seconds=n_frames / 25, size=size)
    )
    frames, scene = list(simulation.frames()), simulation.scene
    cycle = Cycle(
        synthesis=CpuSynthesis(),
        evidence=AutoEvidence(),
        prediction=PolynomialPrediction(),
        estimation=HybridEstimation(most_limbs=0, scatter=8, restarts=0, rounds=1) if quick else HybridEstimation(),
        initialization=PcaInitialization(hypotheses=1, finalists=2) if quick else PcaInitialization(),
        # so that there is a rehearsal however sure it is
        loss=LossRule(sure=1.0, rehearse=n_frames - 1),
        plates=tuple(_quarter_unknown(plate) for plate in simulation.plates),
    )
    usual, found = CpuSynthesis.threads, []
    try:
        for CpuSynthesis.threads in (True, False, True)[quick:]:  # the first one compiles
            found.append(_started(cycle, scene, frames))
    finally:
        CpuSynthesis.threads = usual
    table = Table(
        title=f"a start, a quarter of each view's background unknown, {n_frames} frames", title_justify="left"
    )
    for column in ("way", "wall s", "CPU s", "ratio to the loop", "same pose"):
        table.add_column(column, justify="left" if column == "way" else "right")
    loop, threads = found[-2:]
    for way, (wall_s, cpu_s, q) in (("a loop", loop), ("threads", threads)):
        same = "yes" if np.array_equal(q, loop[2]) else "NO"
        table.add_row(way, f"{wall_s:.1f}", f"{cpu_s:.1f}", f"{loop[0] / wall_s:.2f}x", same)
    console.print(table)


def _started(cycle: Cycle, scene: Scene, frames: list[Frame]) -> tuple[float, float, Array]:
    """Wall and processor seconds, and the pose (dof,)."""
    begin, spent = time.perf_counter(), time.process_time()
    start = cycle.initialization.start(frames[0], scene, cycle.stages)
    start = rehearsed(start, frames[0], scene, cycle, lambda: iter(frames))
    return time.perf_counter() - begin, time.process_time() - spent, start.poses[0]


def _quarter_unknown(plate: Plate | None) -> Plate | None:
    if plate is None:
        return None
    height, width = plate.picture.shape[0], plate.picture.shape[1]
    unknown = np.zeros((height, width), dtype=np.bool_)
    unknown[: height // 2, : width // 2] = True
    return replace(plate, unknown=unknown)
