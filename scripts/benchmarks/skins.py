"""Contours of a skinned mesh, beside rasterizing the same mesh and beside the contours of superquadrics."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from rich.console import Console
from rich.table import Table

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.bodies.body.surface import surface_of
from tracker.bodies.scene import Person, Scene
from tracker.bodies.skin import Skin
from tracker.foundation.arrays import Array
from tracker.foundation.resources import model_path
from tracker.synthesis.cpu import CpuSynthesis
from tracker.synthesis.simulation.sequence import Recipe, simulate

# 20 parts of so many latitudes and longitudes: as many vertices and triangles as a scan has, made coarser.
_GRID = 11, 18
# Of the weights, which blend from part to part over this distance, metres.
_WIDTH_M = 0.05


def compare(console: Console, n_poses: int, quick: bool) -> None:
    """Prints milliseconds of processor time a pose for four views of 720x576."""
    size, n_poses = ((320, 256), 4) if quick else ((720, 576), n_poses)
    simulation = simulate(Recipe(seconds=0.04, size=size))
    bare = load_body(model_path("human"))
    rigid = with_skin(bare)
    assert rigid.skin is not None
    poses = _poses(bare, n_poses)
    scene, smooth, plain = (
        Scene((Person("somebody", body, poses[0]),), simulation.scene.rig)
        for body in (rigid, replace(rigid, skin=_blended(rigid.skin)), bare)
    )
    cpu = CpuSynthesis()
    ways: dict[str, Callable[[], object]] = {
        "rasterizing it, part numbers only": lambda: [cpu.part_ids(scene.with_pose(0, q)) for q in poses[:8]],
        "filling its silhouette": lambda: [cpu.silhouettes(scene.with_pose(0, q)) for q in poses[:8]],
        "contours of it, rigid": lambda: cpu.contours(scene, 0, poses),
        "contours of it, smooth": lambda: cpu.contours(smooth, 0, poses),
        "contours of its superquadrics": lambda: cpu.contours(plain, 0, poses),
    }
    told = f"{len(rigid.skin.points)} vertices, {len(rigid.skin.faces)} triangles, four views {size[0]}x{size[1]}"
    table = Table(title=f"a skin of {told}", title_justify="left")
    for column in ("what", "CPU ms a pose", "to rasterizing"):
        table.add_column(column, justify="left" if column == "what" else "right")
    first = None
    for name, work in ways.items():
        with console.status(name):
            spent = _cpu_ms(work, 1 if quick else 5) / (len(poses) if name.startswith("contours") else len(poses[:8]))
        first = first or spent
        table.add_row(name, f"{spent:.2f}", f"{first / spent:.1f}x")
    console.print(table)


def with_skin(body: BodyModel) -> BodyModel:
    """The body with the meshes of its parts as a skin, rigid."""
    surface = surface_of(body, *_GRID)
    n_points = len(surface.points) // len(body.parts)
    weights = np.eye(len(body.parts)).repeat(n_points, axis=0)
    rest: Array = np.asarray(np.linalg.inv(body.world_from_part(np.zeros(body.dof))), dtype=np.float64)
    return replace(body, skin=Skin(surface.points, surface.faces, weights, rest))


def _blended(skin: Skin) -> Skin:
    """Smooth weights: every part takes a share of the vertices near its own."""
    centres = np.array([skin.points[skin.labels == p].mean(axis=0) for p in range(skin.weights.shape[1])])
    gaps = np.linalg.norm(skin.points[:, None] - centres, axis=2)
    own = gaps[np.arange(len(gaps)), skin.labels][:, None]
    return replace(skin, weights=skin.weights + np.exp(-((np.maximum(gaps - own, 0) / _WIDTH_M) ** 2)))


def _poses(body: BodyModel, n_poses: int) -> Array:
    """Poses (B, dof) scattered about an upright one."""
    q = body.rest()
    q[2] = 0.93
    spread = np.where(body.rotates, np.radians(8.0), 0.03)
    return body.clamped(q + np.random.default_rng(0).normal(size=(n_poses, body.dof)) * spread)


def _cpu_ms(work: Callable[[], object], repeats: int) -> float:
    """Least processor time of this thread, after a run that is not counted, milliseconds."""
    work()
    times = []
    for _ in range(repeats):
        begin = time.thread_time()
        work()
        times.append(time.thread_time() - begin)
    return 1000 * min(times)
