"""Speed and accuracy of the installed package, each beside a reference measured in the same run."""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Annotated

import cv2
import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from tracker.analysis.contours import ContourAnalysis
from tracker.arrays import Array, Image
from tracker.estimation.hybrid import HybridEstimation
from tracker.imaging.edges import canny, gradient
from tracker.initialization.pca import PcaInitialization
from tracker.observation import Observation
from tracker.prediction.polynomial import PolynomialPrediction
from tracker.scene import Scene
from tracker.similarity.chamfer import ChamferSimilarity
from tracker.simulation.rendering import draw_persons, mesh_of
from tracker.simulation.sequence import Recipe, simulate
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking import Cycle, LossRule, track

app = typer.Typer(add_completion=False, no_args_is_help=True, help=__doc__)
console = Console()
SIZES = ((720, 576), (384, 288))


def seconds(work: Callable[[], object], repeats: int = 5) -> float:
    """Least wall time of several runs, after one that is not counted."""
    work()
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)


@app.command()
def poses(n_poses: Annotated[int, typer.Option(help="Poses in a batch.")] = 256) -> None:
    """Poses synthesized into four views and compared in both chamfer directions, per second."""
    table = Table(title="22 DOF, four views, both chamfer directions: poses a second", title_justify="left")
    for column in ("size", "rendering + distance transform", "cpu, 1 thread", "ratio", "cpu, 2 threads", "ratio to 1"):
        table.add_column(column, justify="right")
    for size in SIZES:
        scene, observation, candidates = _situation(size, n_poses)
        reference = _rendered(scene, observation)
        slow = 4 / seconds(lambda q=candidates[:4], f=reference: [f(one) for one in q], 2)  # type: ignore[misc]
        one, two = (n_poses / seconds(_scored(scene, observation, candidates, n)) for n in (1, 2))
        rates = f"{slow:.1f}", f"{one:.0f}", f"{one / slow:.0f}x", f"{two:.0f}", f"{two / one:.2f}x"
        table.add_row(f"{size[0]}x{size[1]}", *rates)
    console.print(table)


def _situation(size: tuple[int, int], n_poses: int) -> tuple[Scene, Observation, Array]:
    """A simulated frame analysed at its true pose, and poses around that."""
    simulation = simulate(Recipe(seconds=0.04, size=size))
    frame = next(simulation.frames())
    scene = simulation.scene.with_pose(0, simulation.poses[0][0])
    observation = ContourAnalysis().observe(frame, CpuSynthesis().contours(scene), simulation.backgrounds)
    rng = np.random.default_rng(0)
    person = scene.persons[0]
    spread = np.where(person.body.rotates, np.radians(8.0), 0.04)
    offsets = spread * rng.normal(size=(n_poses, person.body.dof))
    return scene, observation, person.body.clamped(person.q + offsets)


def _scored(scene: Scene, observation: Observation, candidates: Array, n_threads: int) -> Callable[[], object]:
    synthesis, similarity = CpuSynthesis(), ChamferSimilarity()

    def score(poses: Array) -> Array:
        return similarity.distance(synthesis.contours(scene, 0, poses), observation)

    batches = np.array_split(candidates, max(n_threads, len(candidates) // 32))
    pool = ThreadPoolExecutor(n_threads)
    return lambda: list(pool.map(score, batches))


def _rendered(scene: Scene, observation: Observation) -> Callable[[Array], float]:
    """The reference: each pose is rasterized, its outline found, and both distance transforms compared."""
    meshes = (mesh_of(scene.persons[0]),)
    plates = [np.zeros((*camera.size[::-1], 3), dtype=np.uint8) for camera in scene.rig.cameras]

    def score(q: Array) -> float:
        posed, total = scene.with_pose(0, q), 0.0
        for view, camera, plate in zip(observation.views, scene.rig.cameras, plates, strict=True):
            if view is not None:
                _, mask = draw_persons(plate, camera, posed, meshes)
                outline = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
                edges = np.ones(outline.shape, dtype=np.uint8)
                rows = np.round(view.edges[view.accepted]).astype(int)
                edges[rows[:, 1], rows[:, 0]] = 0
                to_scene = cv2.distanceTransform(edges, cv2.DIST_L2, 5)[outline > 0].mean()
                to_model = cv2.distanceTransform(1 - outline, cv2.DIST_L2, 5)[rows[:, 1], rows[:, 0]].mean()
                total += float(to_scene + to_model)
        return total

    return score


@app.command()
def tracking(n_frames: Annotated[int, typer.Option(min=3, help="Frames tracked.")] = 40) -> None:
    """Milliseconds a frame by stage beside the floor of edge detection alone, and the joint error."""
    table = Table(title="four views, ms a frame", title_justify="left")
    for column in ("size", "analysis", "estimation", "synthesis", "all", "edges alone", "ratio", "joints, mean"):
        table.add_column(column, justify="right")
    for size in SIZES:
        simulation = simulate(Recipe("walking_on_the_spot", seconds=n_frames / 25, size=size))
        frames = list(simulation.frames())
        cycle = Cycle(
            CpuSynthesis(),
            ContourAnalysis(),
            ChamferSimilarity(),
            PolynomialPrediction(),
            HybridEstimation(),
            PcaInitialization(),
            LossRule(),
            simulation.backgrounds,
        )
        steps = list(track(iter(frames), simulation.scene, cycle))[1:]
        spent = Counter[str]()
        for step in steps:
            spent.update(step.seconds)
        stages = {stage: 1000 * value / len(steps) for stage, value in spent.items()}
        floor = 1000 * seconds(lambda images=frames[0].images: [_edges(image) for image in images])  # type: ignore[misc]
        body, truth = simulation.scene.persons[0].body, simulation.poses[0]
        gaps = [
            body.landmarks_in_world(step.estimates[0].q) - body.landmarks_in_world(truth[step.frame.index])
            for step in steps
        ]
        error = 1000 * float(np.linalg.norm(gaps, axis=-1).mean())
        total = sum(stages.values())
        shown = [stages["analysis"], stages["estimation"], stages["synthesis"], total, floor]
        cells = [f"{value:.1f}" for value in shown]
        table.add_row(f"{size[0]}x{size[1]}", *cells, f"{total / floor:.1f}x", f"{error:.1f} mm")
    console.print(table)


def _edges(image: Image | None) -> object:
    assert image is not None
    return canny(gradient(image, 1.0), 3.0, 7.0)


if __name__ == "__main__":
    app()
