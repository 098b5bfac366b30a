"""Is the covariance honest? Real errors over the standard deviations that the estimates tell."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.spatial import cKDTree

from benchmarks.trial import default_cycle, tracked
from tracker.bodies.body import BodyModel
from tracker.bodies.contours import ViewContours
from tracker.bodies.scene import Scene
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.arrays import Array, Mask
from tracker.images.sight import Observation, ViewObservation
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Recipe, Simulation, simulate
from tracker.tracking.estimation.twist_icp import TwistIcpEstimation
from tracker.tracking.objective import Objective

# What was asked of the first release.
AIM = (0.7, 1.5)
_MOVEMENTS = ("two_elbow_rotation", "walking_on_the_spot", "arm_swing", "squat")
# Of edge points; reach and margin are those of the default analysis.
_NOISE_PX, _REACH_PX, _MARGIN_PX = 0.7, 40.0, 48
Pairs = tuple[Array, Array]
"""Errors and predicted standard deviations, both (N, dof), rad and m."""


def compare(console: Console, quick: bool) -> None:
    """Prints errors, sigmas and their ratios for every parameter and pooled by kind."""
    size, seconds, n_seeds, n_noisy = ((320, 240), 0.16, 1, 8) if quick else ((640, 480), 1.4, 2, 200)
    movements = _MOVEMENTS[:1] if quick else _MOVEMENTS
    simulations = [simulate(Recipe(name, seconds=seconds, size=size)) for name in movements]
    body = simulations[0].scene.persons[0].body
    with console.status("tracking rendered frames"):
        rendered = _joined(_rendered(movements, seconds, size, n_seeds))
    with console.status("contours with noise alone"):
        noisy = _joined(_noisy(simulations, n_noisy))
    title = (
        f"error / predicted sigma, aim {AIM[0]} to {AIM[1]}: {len(rendered[0])} rendered frames, "
        f"{len(noisy[0])} contours with {_NOISE_PX} px noise"
    )
    console.print(_table(title, body, (rendered, noisy)))
    console.print(
        "RMS ratio: RMS error over RMS sigma; robust: 1.4826 times the median of |error| / sigma; degrees and mm",
        style="dim",
    )


def _joined(parts: Iterator[Pairs]) -> Pairs:
    errors, sigmas = zip(*parts, strict=True)
    return np.concatenate(errors), np.concatenate(sigmas)


def _rendered(movements: tuple[str, ...], seconds: float, size: tuple[int, int], n_seeds: int) -> Iterator[Pairs]:
    """Frames of several movements and noise seeds, tracked from the true first pose; lost ones left out."""
    for movement in movements:
        for seed in range(n_seeds):
            simulation = simulate(Recipe(movement, seconds=seconds, size=size, seed=seed))
            truth = simulation.poses[0]
            cycle = default_cycle(truth[0], simulation.plates)
            outcome = tracked(simulation.frames(), simulation.scene, truth, cycle)
            kept = ~outcome.lost
            yield (outcome.poses - outcome.truth)[kept], outcome.sigmas[kept]


def _noisy(simulations: list[Simulation], n: int) -> Iterator[Pairs]:
    """Contours of poses of the movements, each point moved along its normal; refined from the true pose."""
    for seed in range(n):
        simulation = simulations[seed % len(simulations)]
        truth = simulation.poses[0]
        q = truth[seed * 7 % len(truth)]
        scene = simulation.scene.with_pose(0, q)
        observation = _contours_as_edges(scene, np.random.default_rng(seed))
        objective = Objective(Comparison(scene, 0, CpuSynthesis(), observation), ContourEvidence())
        estimate = TwistIcpEstimation().estimate(objective, q[None])
        yield (estimate.q - q)[None], np.sqrt(np.diag(estimate.covariance))[None]


def _contours_as_edges(scene: Scene, rng: np.random.Generator) -> Observation:
    """What a faultless analysis would find, with noise that is independent every 8 px of contour."""
    drawn = CpuSynthesis(step_px=8.0, n_eta=17, n_omega=32).contours(scene)
    return Observation(tuple(_edges(drawn.of(v), camera.size, rng) for v, camera in enumerate(scene.rig.cameras)))


def _edges(contours: ViewContours, size: tuple[int, int], rng: np.random.Generator) -> ViewObservation:
    outer: Mask = ~contours.between
    n = int(outer.sum())
    normals = contours.normals[outer]
    edges = (contours.pixels[outer] + _NOISE_PX * rng.normal(size=(n, 1)) * normals).astype(np.float32)
    low = np.maximum(np.floor(edges.min(axis=0)).astype(int) - _MARGIN_PX, 0)
    high = np.minimum(np.ceil(edges.max(axis=0)).astype(int) + _MARGIN_PX, np.array(size) - 1)
    columns, rows = np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(low, high, strict=True)))
    found = cKDTree(edges).query(np.stack([columns, rows], axis=-1), distance_upper_bound=_REACH_PX)
    return ViewObservation(
        edges=edges,
        directions=(rng.choice([-1, 1], (n, 1)) * normals).astype(np.float32),
        segments=np.zeros(n, dtype=np.int64),
        accepted=np.ones(n, dtype=np.bool_),
        scene=np.arange(n),
        scene_weights=contours.weights[outer],
        origin=(int(low[0]), int(low[1])),
        distance=np.minimum(np.asarray(found[0]), _REACH_PX).astype(np.float32),
        reach=_REACH_PX,
    )


def _table(title: str, body: BodyModel, sources: tuple[Pairs, Pairs]) -> Table:
    table = Table(title=title, title_justify="left")
    table.add_column("parameter")
    for source in ("rendered", "noise"):
        for column in ("error", "sigma", "RMS ratio", "robust"):
            table.add_column(f"{source} {column}", justify="right")
    rows = {name: np.array([k]) for k, name in enumerate(body.names)}
    for name, columns in rows.items():
        table.add_row(name, *_cells(body, columns, sources), end_section=name == body.names[-1])
    for kind, columns in kinds(body).items():
        table.add_row(f"all {kind}", *_cells(body, columns, sources), style="bold")
    return table


def kinds(body: BodyModel) -> dict[str, Array]:
    """Kind of parameter -> its columns."""
    found: dict[str, list[int]] = {}
    for k, (name, rotates) in enumerate(zip(body.names, body.rotates.tolist(), strict=True)):
        if name.endswith("_extension"):
            kind = "extensions"
        elif "torso" in name:
            kind = "torso angles" if rotates else "torso translation"
        else:
            kind = "arm angles" if "_arm_" in name else "leg angles"
        found.setdefault(kind, []).append(k)
    return {kind: np.array(columns) for kind, columns in found.items()}


def _cells(body: BodyModel, columns: Array, sources: tuple[Pairs, Pairs]) -> list[str]:
    unit = np.where(body.rotates, np.degrees(1.0), 1000.0)[columns]
    cells = []
    for errors, sigmas in sources:
        error = float(np.sqrt(np.mean((errors[:, columns] * unit) ** 2)))
        sigma = float(np.sqrt(np.mean((sigmas[:, columns] * unit) ** 2)))
        robust = 1.4826 * float(np.median(np.abs(errors[:, columns]) / sigmas[:, columns]))
        cells += [f"{error:.2f}", f"{sigma:.2f}", _judged(error / sigma), _judged(robust)]
    return cells


def _judged(ratio: float) -> str:
    """The ratio, coloured by the aim."""
    colour = "green" if AIM[0] <= ratio <= AIM[1] else "red"
    return f"[{colour}]{ratio:.2f}[/]"
