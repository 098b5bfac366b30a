"""What starts cost: in threads beside a loop, and which part each pixel shows beside rasterization."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.timing import seconds
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.evidence.auto import AutoEvidence
from tracker.foundation.arrays import Array
from tracker.foundation.geometry.superquadrics import meshes_of
from tracker.images.plate import Plate
from tracker.kernels.pictures import rasterize
from tracker.synthesis.cpu import FINEST, CpuSynthesis
from tracker.synthesis.simulation.sequence import Recipe, simulate
from tracker.tracking.cycle import Cycle
from tracker.tracking.estimation.hybrid import HybridEstimation
from tracker.tracking.initialization.pca import PcaInitialization
from tracker.tracking.loss import LossRule
from tracker.tracking.prediction.polynomial import PolynomialPrediction
from tracker.tracking.rehearsal import rehearsed

_N_POSES = 24
"""Places of a limb whose colours are looked at."""


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
        estimation=HybridEstimation(most_limbs=0, rounds=1) if quick else HybridEstimation(),
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
    console.print(_shown_parts(scene))


def _shown_parts(scene: Scene) -> Table:
    """Which parts the pixels of half-size views show in poses with an arm elsewhere, as limbs of starts are judged."""
    small, person = Scene(scene.persons, scene.rig.downscaled(2)), scene.persons[0]
    poses = np.tile(person.q, (_N_POSES, 1))
    poses[:, person.body.index("left_arm_extension")] += np.linspace(0.0, 0.5, _N_POSES)
    synthesis = CpuSynthesis()
    ways: dict[str, Callable[[], Sequence[Sequence[NDArray[np.signedinteger]]]]] = {
        "rasterized": lambda: [_rasterized(small.with_pose(0, q)) for q in poses],
        "row by row": lambda: [synthesis.part_ids(small.with_pose(0, q)) for q in poses],
        "still parts once": lambda: list(synthesis.ids_of_poses(small, 0, poses)),
    }
    table = Table(title=f"parts seen by {len(small.rig)} views, {_N_POSES} poses of an arm", title_justify="left")
    for column in ("way", "ms a pose", "ratio to rasterized", "pixels that differ"):
        table.add_column(column, justify="left" if column == "way" else "right")
    times = {way: seconds(work, 3) / _N_POSES for way, work in ways.items()}
    first, *_ = found = [np.concatenate([ids.ravel() for views in work() for ids in views]) for work in ways.values()]
    for (way, time_s), ids in zip(times.items(), found, strict=True):
        differ = f"{np.count_nonzero(ids != first)} of {np.count_nonzero(first >= 0)}"
        table.add_row(way, f"{1000 * time_s:.2f}", f"{times['rasterized'] / time_s:.1f}x", differ)
    return table


def _rasterized(scene: Scene) -> list[NDArray[np.signedinteger]]:
    """Part numbers (H, W) in each view from the z-buffer of all triangles, -1 for none."""
    meshes, placements = meshes_of(scene.shapes, *FINEST), scene.world_from_parts()[0]
    points = (meshes.points @ np.swapaxes(placements[:, :3, :3], -1, -2) + placements[:, None, :3, 3]).reshape(-1, 3)
    firsts = meshes.points.shape[1] * np.arange(len(scene.shapes))
    triangles, found = (firsts[:, None, None] + meshes.triangles).reshape(-1, 3), []
    for camera in scene.rig.cameras:
        buffers = np.zeros((*camera.size[::-1], 4), dtype=np.float32)
        rasterize(camera.project(points), camera.in_camera(points)[:, 2], triangles, (0, 0), buffers)
        found.append(np.where(buffers[..., 0] > 0, buffers[..., 1].astype(np.int64) // len(meshes.triangles), -1))
    return found


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
