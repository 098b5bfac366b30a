"""Poses a second of every synthesis, beside rendering and distance transforms."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.timing import seconds
from tracker.bodies.scene import Scene
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.similarity.chamfer import ChamferSimilarity
from tracker.foundation.arrays import Array, Image
from tracker.foundation.configuration.components import available, find
from tracker.images.analysis.contours import ContourAnalysis
from tracker.images.sight import Observation, Sight
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.rendering import draw_persons, mesh_of
from tracker.synthesis.simulation.sequence import Recipe, simulate

# PAL, and the size of the paper's images.
SIZES = ((720, 576), (384, 288))
Score = Callable[[Array], object]
"""Compares poses (B, dof) with the observation."""


def compare(console: Console, n_poses: int, quick: bool) -> None:
    """Prints a row for each size and synthesis; one that cannot be opened says why."""
    sizes, n_poses, repeats = (((320, 240),), 32, 1) if quick else (SIZES, n_poses, 5)
    table = Table(title="22 DOF, four views, both chamfer directions: poses a second", title_justify="left")
    table.add_column("size")
    table.add_column("synthesis")
    for column in ("1 thread", "to rasterizing", "to pyrender", "2 threads", "to 1 thread"):
        table.add_column(column, justify="right")
    for size in sizes:
        with console.status(f"{size[0]}x{size[1]}: references"):
            scene, observation, candidates = _situation(size, n_poses)
            opened = {name: _opened(name, scene) for name in available("synthesis")}
            slow = _reference_rate(_rasterized(scene), scene, observation, candidates)
            slower = None
            if not isinstance(opened.get("osmesa", ""), str):
                slower = _reference_rate(_drawn(opened["osmesa"], scene), scene, observation, candidates)
        label = f"{size[0]}x{size[1]}"
        table.add_row(label, "rasterizing + distance transform", f"{slow:.1f}", "1x", "", "", "")
        if slower:
            table.add_row(
                label, "pyrender ids + edges + distance transform", f"{slower:.1f}", _times(slower, slow), "1x"
            )
        for name, component in opened.items():
            if isinstance(component, str):
                table.add_row(label, name, component, style="bright_black")
                continue
            with console.status(f"{label}: {name}"):
                one = _rate(component, scene, observation, candidates, 1, repeats)
                # A GL context belongs to one thread.
                two = _rate(component, scene, observation, candidates, 2, repeats) if name == "cpu" else None
            rates = f"{one:.0f}", _times(one, slow), _times(one, slower)
            table.add_row(label, name, *rates, f"{two:.0f}" if two else "-", _times(two, one))
        table.add_section()
    console.print(table)


def _times(rate: float | None, reference: float | None) -> str:
    if not rate or not reference:
        return "-"
    ratio = rate / reference
    return f"{ratio:.0f}x" if ratio >= 10 else f"{ratio:.2f}x"


def _situation(size: tuple[int, int], n_poses: int) -> tuple[Scene, Observation, Array]:
    """A simulated frame analysed at its true pose, and poses around that."""
    simulation = simulate(Recipe(seconds=0.04, size=size))
    frame = next(simulation.frames())
    scene = simulation.scene.with_pose(0, simulation.poses[0][0])
    observation = ContourAnalysis().observe(Sight(frame, simulation.plates), CpuSynthesis().contours(scene))
    rng = np.random.default_rng(0)
    person = scene.persons[0]
    spread = np.where(person.body.rotates, np.radians(8.0), 0.04)
    offsets = spread * rng.normal(size=(n_poses, person.body.dof))
    return scene, observation, person.body.clamped(person.q + offsets)


def _opened(name: str, scene: Scene) -> Any:
    """The component of that name, or the reason why it does not work here."""
    try:
        component = find("synthesis", name)()
        component.contours(scene)
    # A GL library may fail in any way: the reason is shown.
    except Exception as error:
        return f"{type(error).__name__}: {str(error).splitlines()[0] if str(error) else 'no reason given'}"
    return component


def _rate(
    component: Any, scene: Scene, observation: Observation, candidates: Array, n_threads: int, repeats: int
) -> float:
    """Poses a second; of fewer poses where a batch would take long."""
    score = _score(component, scene, observation)
    candidates = candidates[: _affordable(score, candidates, 0.3 * repeats)]
    batches = np.array_split(candidates, n_threads)
    with ThreadPoolExecutor(n_threads) as pool:
        work = (lambda: list(pool.map(score, batches))) if n_threads > 1 else (lambda: [score(candidates)])
        return len(candidates) / seconds(work, repeats)


def _affordable(score: Score, candidates: Array, budget_s: float) -> int:
    """How many poses a run may have to last no longer than a time; software rendering does a few a second."""
    few = candidates[:2]
    score(few)
    begin = time.perf_counter()
    score(few)
    return max(len(few), int(budget_s * len(few) / (time.perf_counter() - begin)))


def _score(component: Any, scene: Scene, observation: Observation) -> Score:
    """Both chamfer directions."""
    similarity, asked = ChamferSimilarity(), Comparison(scene, 0, component, observation)
    return lambda poses: similarity.distances(asked, poses)


Outlines = Callable[[Array], list[Image]]
"""The model's outline in each view (h, w), 1 on it, 0 elsewhere, for a pose (dof,)."""


def _rasterized(scene: Scene) -> Outlines:
    """Outlines of the simulation's own rasterizer."""
    meshes = (mesh_of(scene.persons[0]),)
    plates = [np.zeros((*camera.size[::-1], 3), dtype=np.uint8) for camera in scene.rig.cameras]
    kernel = np.ones((3, 3), np.uint8)

    def outlines(q: Array) -> list[Image]:
        posed = scene.with_pose(0, q)
        pairs = zip(plates, scene.rig.cameras, strict=True)
        masks = (draw_persons(plate, camera, posed, meshes)[1] for plate, camera in pairs)
        return [cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_GRADIENT, kernel) for mask in masks]

    return outlines


def _drawn(component: Any, scene: Scene) -> Outlines:
    """Outlines from rendered pictures of part numbers."""

    def outlines(q: Array) -> list[Image]:
        contours, images = component.contours(scene, 0, q[None]), []
        for v, camera in enumerate(scene.rig.cameras):
            image = np.zeros(camera.size[::-1], dtype=np.uint8)
            pixels = np.round(contours.of(v).pixels).astype(int)
            inside = ((pixels >= 0) & (pixels < camera.size)).all(axis=1)
            image[pixels[inside, 1], pixels[inside, 0]] = 1
            images.append(image)
        return images

    return outlines


def _reference_rate(outlines: Outlines, scene: Scene, observation: Observation, candidates: Array) -> float:
    """Poses a second of the textbook way: draw, find the outline, transform both edge images, look up."""
    few = candidates[:4]
    return len(few) / seconds(lambda: [_transformed(outlines(q), observation) for q in few], 2)


def _transformed(outlines: list[Image], observation: Observation) -> float:
    total = 0.0
    for view, outline in zip(observation.views, outlines, strict=True):
        if view is None or not outline.any():
            continue
        edges = np.ones(outline.shape, dtype=np.uint8)
        rows = np.round(view.edges[view.accepted]).astype(int)
        edges[rows[:, 1], rows[:, 0]] = 0
        to_scene = cv2.distanceTransform(edges, cv2.DIST_L2, 5)[outline > 0].mean()
        to_model = cv2.distanceTransform(1 - outline, cv2.DIST_L2, 5)[rows[:, 1], rows[:, 0]].mean()
        total += float(to_scene + to_model)
    return total
