"""Measured surfaces against what is known of them: a cylinder, a ring of triplets, a pair with true disparities."""

from __future__ import annotations

import os
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.optimize import least_squares
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from benchmarks import bare_skin
from tracker.cameras.triangulation import triangulate
from tracker.foundation.arrays import Array, Mask
from tracker.points.surfaces import LeastSquaresMatching, PatchImage
from tracker.points.surfaces.surface import Surface, measure_surface, residual_rms_px
from tracker.running.jobs import load_job
from tracker.running.jobs.surface import SurfaceJob

CONFIGS = Path(__file__).parents[2] / "configs" / "surfaces"
# Of the cylinder and its positions, by the README of the recording.
RADIUS_MM = 57.15
N_POSITIONS = 5
# Middle ones of the triplets of neighbouring pictures of the temple.
TRIPLETS = range(14, 31, 2)


def compare(console: Console, only: str, quick: bool) -> None:
    """Prints a table for each of the recordings; quick: the pair and one triplet."""
    cv2.setNumThreads(1)
    if "BODYTRACK_DATA" not in os.environ:
        console.print("BODYTRACK_DATA is not set: no recordings to measure")
        return
    parts = {"motorcycle": _motorcycle, "temple": _temple, "cylinder": _cylinder, "skin": _skin}
    for name, part in parts.items():
        if only in name and not (quick and name == "cylinder"):
            part(console, quick)


def _skin(console: Console, quick: bool) -> None:
    bare_skin.compare(console, load_job("surface", CONFIGS / "skin.toml", ()), quick)


def _measured(name: str, overrides: tuple[str, ...] = ()) -> tuple[SurfaceJob, Surface, float]:
    """The surface of a configuration, and the seconds it took without reading the images."""
    run = load_job("surface", CONFIGS / f"{name}.toml", overrides)
    sequence = run.reading.open()
    frame = next(iter(sequence.frames()))
    begin = time.perf_counter()
    surface = measure_surface(run, frame, sequence.rig)
    return run, surface, time.perf_counter() - begin


def _motorcycle(console: Console, quick: bool) -> None:
    with console.status("motorcycle"):
        _, surface, seconds = _measured("motorcycle", ("growth.step_px=8",) if quick else ())
    folder = Path(os.environ["BODYTRACK_DATA"], "stereo_gt", "motorcycle")
    truth = np.load(folder / "motorcycle_disp.npz")["arr_0"]
    left, right = surface.points.pixels
    columns, rows = left.astype(int).T
    true = truth[rows, columns]
    known = np.isfinite(true)
    errors = (left - right)[known, 0] - true[known]
    table = _table("motorcycle: disparities against the truth")
    table.add_row(
        "points",
        str(len(errors)),
        "",
        f"in {seconds:.1f} s; of a grid that would hold {_grid_of(truth, surface)} known",
    )
    _row(table, "median error", float(np.median(np.abs(errors))), "px", 0.10)
    _row(table, "median, constant offset removed", float(np.median(np.abs(errors - np.median(errors)))), "px")
    for limit in (0.5, 1.0, 3.0):
        _row(table, f"more than {limit:g} px off", 100 * float(np.mean(np.abs(errors) > limit)), "%")
    console.print(table)


def _grid_of(truth: Array, surface: Surface) -> int:
    step = next(field.step_px for field in surface.fields if field is not None)
    return int(np.isfinite(truth[::step, ::step]).sum())


def _temple(console: Console, quick: bool) -> None:
    clouds, seconds = [], 0.0
    centres = list(TRIPLETS)[: 2 if quick else None]
    for centre in centres:
        views = [f"templeR{centre + k:04d}" for k in (-1, 0, 1)]
        with console.status(f"temple: {', '.join(views)}"):
            overrides = f"reading.views={views}", f"template={views[1]}", *(("growth.step_px=4",) if quick else ())
            _, surface, spent = _measured("temple", overrides)
        clouds.append(surface.points)
        seconds += spent
    gaps = np.concatenate([_to_planes(a.points, b.points) for a, b in pairwise(clouds)])
    sigmas = np.concatenate([cloud.sigma_m for cloud in clouds])
    n_points = sum(map(len, clouds))
    rms = float(np.sqrt(sum(len(cloud) * residual_rms_px(cloud) ** 2 for cloud in clouds) / n_points))
    table = _table(f"temple: {len(clouds)} triplets, neighbouring ones with one image in common")
    table.add_row("points", _judged(str(n_points), n_points >= 115e3), "115000", f"in {seconds:.1f} s")
    _row(table, "three rays, RMS of coordinates", rms, "px", 0.11)
    _row(table, "three rays, RMS of distances", rms * np.sqrt(2), "px", 0.11)
    _row(table, "between neighbouring triplets, median", 1000 * float(np.median(gaps)), "mm", 0.15)
    _row(table, "predicted point error, median", 1000 * float(np.median(sigmas)), "mm")
    table.add_row("points compared", str(len(gaps)), "", "distance to the plane of the 8 nearest points")
    console.print(table)


def _to_planes(one: Array, other: Array, reach_m: float = 0.002) -> Array:
    """Distances (M,) of the points of one cloud to planes through the 8 nearest of the other, where these are near."""
    distances, nearest = (np.asarray(found) for found in cKDTree(one).query(other, k=8))
    near = distances[:, -1] < reach_m
    neighbours = one[nearest[near]]
    centres = neighbours.mean(axis=1)
    normals = np.linalg.svd(neighbours - centres[:, None])[2][:, 2]
    gaps: Array = np.abs(((other[near] - centres) * normals).sum(axis=1))
    return gaps


def _cylinder(console: Console, quick: bool) -> None:
    with console.status("cylinder: surface"):
        run, surface, seconds = _measured("cylinder")
    cloud = 1000 * surface.points.points
    radius, residuals = _fitted_cylinder(cloud)
    table = _table("cylinder: radius 57.15 mm")
    table.add_row("points", str(len(cloud)), "", f"in {seconds:.1f} s; all of them in the fit")
    table.add_row(
        "radius", _judged(f"{radius:.3f} mm", abs(radius - RADIUS_MM) <= 0.05), "57.15 +- 0.05", "least squares"
    )
    _row(table, "residuals, RMS", float(np.sqrt(np.mean(residuals**2))), "mm", 0.03)
    _row(table, "residuals, 95 %", float(np.percentile(np.abs(residuals), 95)), "mm")
    with console.status("cylinder: tracked through five positions"):
        positions = _tracked(run, surface)
    for k, moved in enumerate(positions[1:], start=1):
        kept = np.isfinite(moved).all(axis=1) & np.isfinite(positions[0]).all(axis=1)
        rms, shift = _rigid_residual(1000 * positions[0][kept], 1000 * moved[kept])
        note = f"{kept.sum()} points tracked, moved by {shift:.2f} mm"
        _row(table, f"rigid motion 0 to {k}, residual RMS", rms, "mm", 0.02, note)
    console.print(table)


def _fitted_cylinder(points: Array) -> tuple[float, Array]:
    """Radius and distances (N,) of points (N, 3) from the cylinder of least squares; its axis is near the z axis."""

    def distances(parameters: Array) -> Array:
        x, y, dx, dy, radius = parameters
        axis = np.array([dx, dy, 1.0]) / np.sqrt(dx * dx + dy * dy + 1)
        offset = points - (x, y, 0.0)
        across = offset - (offset @ axis)[:, None] * axis
        return np.asarray(np.linalg.norm(across, axis=1) - radius)

    fit = least_squares(distances, [0.0, 0.0, 0.0, 0.0, 50.0])
    return float(fit.x[4]), distances(fit.x)


def _tracked(run: SurfaceJob, surface: Surface) -> list[Array]:
    """The points of the first position in all (N, 3) m: least squares matching through time, NaN where lost."""
    pattern = str(vars(run.reading)["path"])
    matching = replace(run.matching, max_shift_px=8.0)
    names = [view.camera.name for view in surface.views]
    template = matching.prepared(surface.views[surface.template].grey)
    at = surface.points.pixels[surface.template]
    field = next(field for field in surface.fields if field is not None)
    cells = field.cells_of(at)
    affine = [np.tile(np.eye(2), (len(at), 1, 1)), field.matches.affine[cells]]
    places = [surface.points.pixels[v].copy() for v in range(2)]
    velocity = [np.zeros_like(at) for _ in range(2)]
    positions = []
    for k in range(N_POSITIONS):
        for v, name in enumerate(names):
            image = _prepared(pattern, name, k, matching)
            matches = matching.match(template, image, at, places[v] + velocity[v], affine[v])
            good: Mask = run.growth.good(matches)
            moved = np.where(good[:, None], matches.pixels, np.nan)
            velocity[v], places[v] = moved - places[v], moved
        cameras = [view.camera for view in surface.views]
        positions.append(triangulate(cameras, np.stack(places))[0])
    return positions


def _prepared(pattern: str, view: str, k: int, matching: LeastSquaresMatching) -> PatchImage:
    path = pattern.replace("{view}", view).replace("{frame}", str(k))
    grey = np.asarray(cv2.imread(path, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
    return matching.prepared(grey)


def _rigid_residual(one: Array, other: Array) -> tuple[float, float]:
    """RMS of what is left after the best rigid motion, per point, and the mean distance moved; units as given."""
    a, b = one - one.mean(axis=0), other - other.mean(axis=0)
    rotation, _ = Rotation.align_vectors(b, a)
    left = b - rotation.apply(a)
    return float(np.sqrt((left**2).sum(axis=1).mean())), float(np.linalg.norm(other - one, axis=1).mean())


def _table(title: str) -> Table:
    table = Table(title=title, title_justify="left")
    for name in ("", "measured", "aim", ""):
        table.add_column(name, justify="right" if name == "measured" else "left")
    return table


def _row(table: Table, name: str, value: float, unit: str, aim: float | None = None, note: str = "") -> None:
    text = f"{value:.3f} {unit}"
    table.add_row(name, text if aim is None else _judged(text, value <= aim), f"{aim:g}" if aim else "", note)


def _judged(text: str, good: bool) -> str:
    return f"[{'green' if good else 'red'}]{text}[/]"
