"""Points followed on a moving back whose surface is known exactly, beside pyramidal Lucas-Kanade."""

from __future__ import annotations

import importlib
import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks import snakes
from tracker.arrays import Array, Image, Mask
from tracker.following.births import chosen_evenly, points_of_image, points_of_surface
from tracker.following.following import Following
from tracker.following.points import NewPoints
from tracker.following.sequence import follow
from tracker.frame import Frame
from tracker.kernels.compilation import compiled
from tracker.lsm.growth import Growth
from tracker.lsm.surface import SurfaceMeasurement, measure_surface
from tracker.lsm.views import Preparation
from tracker.point_trajectories import PointFrame, PointStatus
from tracker.rig import Rig
from tracker.rig_layouts import load_rig
from tracker.triangulation import triangulate

# As issue and paper have: points on the shirt, and what counts as another material point.
N_POINTS, WRONG_MM = 1500, 5.0
VIEWS = ("left", "centre", "right")
# The middle one of three cameras in line holds the templates.
CENTRE = 1

Change = Callable[[int, tuple[Image, ...]], tuple[Image, ...]]


def compare(console: Console, only: str, quick: bool) -> None:
    """Prints a table for each question; quick: few frames."""
    cv2.setNumThreads(1)
    if "BODYTRACK_DATA" not in os.environ:
        console.print("BODYTRACK_DATA is not set: no recordings to follow points on")
        return
    back = _Back(Path(os.environ["BODYTRACK_DATA"], "closerange"), 5 if quick else 51)
    parts = {
        "shirt": _shirt,
        "hidden": _hidden,
        "interlaced": _interlaced,
        "flat": _flat,
        "rate": _rate,
        "snakes": _snakes,
    }
    for name, part in parts.items():
        if only in name:
            table = Table(
                "", "measured", "aim", "", title=f"back, {back.n_frames} frames: {name}", title_justify="left"
            )
            part(table, back)
            console.print(table)


@dataclass(frozen=True)
class _Start:
    """Points on the surface at frame 0, and where they truly go."""

    new: NewPoints
    material: Any
    positions: Array
    """(T, N, 3) metres."""

    visible: Mask
    """(T, V, N)"""


class _Back:
    """The recording, its truth, and points to start from."""

    def __init__(self, folder: Path, n_frames: int) -> None:
        self.folder, self.n_frames = folder / "back", n_frames
        self.truth = _truth_of(folder).Truth(self.folder)
        self.rig: Rig = load_rig(self.folder / "calibration.json")
        self._starts: dict[tuple[int, int], _Start] = {}

    def images(self, index: int) -> tuple[Image, ...]:
        """Grey images of a frame."""
        paths = (self.folder / "images" / f"{view}_{index:03d}.jpg" for view in VIEWS)
        return tuple(np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), dtype=np.uint8) for path in paths)

    def frames(self, change: Change | None = None) -> Iterator[Frame]:
        """All frames, changed."""
        for index in range(self.n_frames):
            images = self.images(index)
            yield Frame(index, index / 50, images if change is None else change(index, images))

    def start(self, n_points: int, step_px: int = 3, cloth: bool = True) -> _Start:
        """Points of a measured surface whose truth is known."""
        if (n_points, step_px) not in self._starts:
            measurement = SurfaceMeasurement(growth=Growth(step_px=step_px))
            new = points_of_surface(measure_surface(measurement, Frame(0, 0.0, self.images(0)), self.rig))
            material = self.truth.material(new.pixels[CENTRE], CENTRE, 0)
            known = (material[0] >= 0) & (self.truth.on_cloth(material) | (not cloth))
            rows = np.flatnonzero(known)
            rows = rows[chosen_evenly(len(rows), n_points)]
            self._starts[n_points, step_px] = self.known(new.select(rows), tuple(part[rows] for part in material))
        return self._starts[n_points, step_px]

    def known(self, new: NewPoints, material: Any) -> _Start:
        """Points with where they truly go."""
        positions, visible = [], []
        for index in range(self.n_frames):
            positions.append(self.truth.where(material, index))
            visible.append([self.truth.visible(material, index, view, 0.006) for view in range(len(VIEWS))])
            self.truth._cache.clear()
        return _Start(new, material, np.array(positions), np.array(visible))


def _truth_of(folder: Path) -> Any:
    """The module beside the recording, its kernel compiled anew: a folder of recordings is no place for a cache."""
    sys.path.insert(0, str(folder))
    written, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    truth: Any = importlib.import_module("truth")
    sys.dont_write_bytecode = written
    truth._raster = compiled(truth._raster.py_func)
    return truth


@dataclass(frozen=True)
class _Errors:
    """Of the last frame."""

    distance_mm: Array
    """(N,) NaN for points that are not seen."""

    visible: Mask
    """(N,) points that all views show in all frames."""

    @property
    def median_mm(self) -> float:
        return float(np.nanmedian(self.distance_mm))

    @property
    def left(self) -> float:
        """Of the visible points, %."""
        return 100 * float(np.isfinite(self.distance_mm[self.visible]).mean())

    @property
    def wrong(self) -> float:
        """Of the points that are seen, %."""
        kept = self.distance_mm[np.isfinite(self.distance_mm)]
        return 100 * float((kept > WRONG_MM).mean())

    def rows(self, table: Table, name: str, judged: bool = True) -> None:
        """Adds them to a table."""
        note = f"{self.visible.sum()} visible points"
        for what, value, unit, aim, more in (
            ("left of those visible throughout", self.left, "%", 95.0, True),
            ("median error", self.median_mm, "mm", 0.20, False),
            (f"more than {WRONG_MM:g} mm off", self.wrong, "%", 0.1, False),
        ):
            _row(table, f"{name}: {what}", value, unit, aim if judged else None, more, note)


def _errors(start: _Start, last: PointFrame) -> _Errors:
    distance = 1000 * np.linalg.norm(last.positions - start.positions[last.index], axis=1)
    visible: Mask = np.asarray(start.visible[: last.index + 1].all(axis=(0, 1)))
    return _Errors(distance, visible)


def _followed(
    back: _Back, start: _Start, following: Following, change: Change | None = None
) -> tuple[list[PointFrame], float]:
    """All frames, and CPU seconds a frame without reading images."""
    frames, seconds = [], 0.0
    stream = follow(following, Preparation(), back.rig, back.frames(change), lambda frame: start.new)
    while True:
        begin = time.process_time()
        step = next(stream, None)
        if step is None:
            break
        frames.append(step[0])
        # The first frame begins and the second compiles.
        seconds += time.process_time() - begin if len(frames) > 2 else 0.0
    begin = time.process_time()
    for _ in back.frames(change):
        pass
    reading = time.process_time() - begin
    return frames, seconds / max(len(frames) - 2, 1) - reading / len(frames)


def _shirt(table: Table, back: _Back) -> None:
    start = back.start(N_POINTS)
    frames, _ = _followed(back, start, Following())
    ours = _errors(start, frames[-1])
    ours.rows(table, "key patches")
    sigma = 1000 * np.sqrt(np.trace(frames[-1].covariances, axis1=1, axis2=2))
    table.add_row("error / sigma, median", f"{np.nanmedian(ours.distance_mm / sigma):.2f}", "", "three axes together")
    status = np.stack([frame.status for frame in frames])
    table.add_row("keys replaced", str(int((status == PointStatus.REKEYED).sum())), "", "of points, in all frames")
    before = Following(template="previous", start="correlation")
    theirs = _errors(start, _followed(back, start, before)[0][-1])
    theirs.rows(table, "previous frame's patches, correlation (the paper)", judged=False)
    flow = _errors(start, _lucas_kanade(back, start))
    flow.rows(table, "Lucas-Kanade and ray intersection", judged=False)
    _row(table, "Lucas-Kanade's median error / ours", flow.median_mm / ours.median_mm, "", 3.0, True)


def _lucas_kanade(back: _Back, start: _Start) -> PointFrame:
    """OpenCV's pyramidal Lucas-Kanade in each view; points whose rays miss by more than a pixel are lost."""
    pixels, before, images = start.new.pixels.copy(), np.full_like(start.new.pixels, np.nan), back.images(0)
    alive = np.ones(pixels.shape[1], dtype=np.bool_)
    flags = cv2.OPTFLOW_USE_INITIAL_FLOW
    for index in range(1, back.n_frames):
        now, moved = back.images(index), np.full_like(pixels, np.nan)
        for v in range(len(VIEWS)):
            linear = np.where(np.isfinite(before[v]), 2 * pixels[v] - before[v], pixels[v])
            at, to = (x[alive][:, None].astype(np.float32) for x in (pixels[v], linear))
            found, status, _ = cv2.calcOpticalFlowPyrLK(
                images[v], now[v], at, to, winSize=(21, 21), maxLevel=3, flags=flags
            )
            moved[v, alive] = np.where(status > 0, found[:, 0], np.nan)
        points, _ = triangulate(back.rig.cameras, moved)
        gaps = back.rig.project(points) - moved
        alive &= np.sqrt((gaps**2).mean(axis=(0, 2))) < 1.0
        moved[:, ~alive] = np.nan
        images, before, pixels = now, pixels, moved
    points[~alive] = np.nan
    n, status, unknown = len(points), alive.astype(np.int64), np.full_like(pixels, np.nan)
    places = np.arange(n), pixels, unknown, points, np.full((n, 3, 3), np.nan), np.full(n, np.nan)
    return PointFrame(index, index / 50, *places, status, np.zeros(n, np.int64), np.zeros((3, n), np.int64))


def _hidden(table: Table, back: _Back) -> None:
    for width_m, distance_m in ((0.10, 1.9), (0.25, 1.5)):
        _behind(table, back, _Strip(back.rig, back.n_frames, width_m, distance_m))


def _behind(table: Table, back: _Back, strip: _Strip) -> None:
    """Points that a strip passes before; the wide one hides all of them from one view or another at a time."""
    start = back.start(N_POINTS)
    frames, _ = _followed(back, start, Following(), strip.painted)
    covered = np.stack([strip.covered(k, back.rig.project(start.positions[k])) for k in range(back.n_frames)])
    shown = start.visible & ~covered
    last = frames[-1]
    for_a_time = ~shown.all(axis=(0, 1)) & shown[-1].all(axis=0) & shown[0].all(axis=0)
    seen = np.stack([frame.alive for frame in frames])
    lost_for_it = for_a_time & ~seen.all(axis=0)
    errors = _errors(start, last).distance_mm[lost_for_it]
    back_again = np.isfinite(errors)
    name = f"strip of {strip.width_m:g} m at {strip.distance_m:g} m"
    alive = 100 * seen.mean(axis=1).min()
    note = f"{lost_for_it.sum()} of {for_a_time.sum()} points that it hides for a time; {alive:.0f} % seen at the least"
    _row(table, f"{name}: found again", 100 * float(back_again.mean()), "%", 85.0, True, note)
    _row(table, f"{name}: wrong among them", int((errors[back_again] > WRONG_MM).sum()), "", 0.0, False)
    if back_again.any():
        _row(table, f"{name}: median error of them", float(np.median(errors[back_again])), "mm")
    behind = np.array([(seen[k] & covered[k].all(axis=0)).sum() for k in range(back.n_frames)])
    off = [
        (1000 * np.linalg.norm(f.positions - start.positions[k], axis=1)[covered[k].all(axis=0)] > WRONG_MM).sum()
        for k, f in enumerate(frames)
    ]
    table.add_row(f"{name}: seen though hidden", str(int(behind.sum())), "", f"in all views; {sum(off)} wrong")


class _Strip:
    """A textured upright strip that passes between the cameras and the back."""

    def __init__(self, rig: Rig, n_frames: int, width_m: float, distance_m: float) -> None:
        self.width_m, self.distance_m = width_m, distance_m
        centre = rig.cameras[CENTRE]
        self._axes = centre.camera_from_world[:3, :3]
        self._origin = centre.centre + self.distance_m * self._axes[2]
        self._rig, self._n = rig, n_frames
        size = centre.size
        pixels = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).astype(np.float64)
        self._places = [self._place(view, pixels) for view in range(len(rig))]
        rng = np.random.default_rng(0)
        self._texture = cv2.GaussianBlur(rng.normal(size=(2048, 1024)).astype(np.float32), (0, 0), 3.0)
        self._texture *= 25 / self._texture.std()

    def _place(self, view: int, pixels: Array) -> Array:
        """Metres to the right and down (..., 2) where rays meet the strip's plane."""
        camera = self._rig.cameras[view]
        rays = camera.rays(pixels)
        depth = ((self._origin - camera.centre) @ self._axes[2]) / (rays @ self._axes[2])
        place: Array = (camera.centre + depth[..., None] * rays - self._origin) @ self._axes[:2].T
        return place

    def _left(self, index: int) -> float:
        """Its left edge, m: outside the images at first and at last."""
        return -0.75 + (1.5 - self.width_m) * index / max(self._n - 1, 1)

    def painted(self, index: int, images: tuple[Image, ...]) -> tuple[Image, ...]:
        """The images with the strip before the back."""
        painted = []
        for place, image in zip(self._places, images, strict=True):
            right = place[..., 0] - self._left(index)
            column, row = (right * 2000).astype(int) % 1024, ((place[..., 1] + 1) * 1000).astype(int) % 2048
            grey = np.clip(110 + self._texture[row, column], 0, 255).astype(np.uint8)
            painted.append(np.where((right >= 0) & (right <= self.width_m), grey, image))
        return tuple(painted)

    def covered(self, index: int, pixels: Array) -> Mask:
        """(V, N) pixels that show the strip."""
        right = np.stack([self._place(v, pixels[v])[:, 0] for v in range(len(pixels))]) - self._left(index)
        covered: Mask = (right >= 0) & (right <= self.width_m)
        return covered


def _interlaced(table: Table, back: _Back) -> None:
    start = back.start(N_POINTS)
    progressive = _errors(start, _followed(back, start, Following())[0][-1])
    preparation = Preparation(odd_lines_only=True)
    measurement = SurfaceMeasurement(growth=Growth(step_px=3), preparation=preparation)

    def woven(index: int) -> Frame:
        pairs = zip(back.images(index), back.images(min(index + 1, back.n_frames - 1)), strict=True)
        images = []
        for first, second in pairs:
            image = first.copy()
            image[1::2] = second[1::2]
            images.append(image)
        return Frame(index, index / 50, tuple(images))

    new = points_of_surface(measure_surface(measurement, woven(0), back.rig))
    places = np.stack([new.pixels[CENTRE, :, 0], 2 * new.pixels[CENTRE, :, 1]], axis=1)
    material = back.truth.material(places, CENTRE, 0)
    rows = np.flatnonzero((material[0] >= 0) & back.truth.on_cloth(material))
    rows = rows[chosen_evenly(len(rows), N_POINTS)]
    own = back.known(new.select(rows), tuple(part[rows] for part in material))
    frames = (woven(index) for index in range(0, back.n_frames, 2))
    *_, (last, _) = follow(Following(), preparation, back.rig, frames, lambda frame: own.new)
    errors = _errors(own, last)
    _row(table, "odd lines, 25 Hz: median error", errors.median_mm, "mm")
    _row(table, "left of those visible throughout", errors.left, "%")
    _row(table, "median error / progressive's", errors.median_mm / progressive.median_mm, "", 1.4)


def _flat(table: Table, back: _Back) -> None:
    start, camera = back.start(N_POINTS), back.rig.cameras[CENTRE]
    new, visible = points_of_image(start.new.pixels[CENTRE]), start.visible[:, CENTRE].all(axis=0)
    usual = Following().for_views(1)
    for following in (usual, replace(usual, matching=usual.matching.with_patch(21))):
        patch_px = following.matching.patch_px
        frames = (replace(frame, images=frame.images[CENTRE : CENTRE + 1]) for frame in back.frames())
        *_, (last, _) = follow(following, Preparation(), Rig((camera,)), frames, lambda frame: new)
        errors = np.linalg.norm(last.pixels[0] - camera.project(start.positions[last.index]), axis=1)
        name = f"centre view alone, {patch_px} px patches"
        _row(table, f"{name}: median error", float(np.nanmedian(errors)), "px", 0.07)
        _row(table, f"{name}: left of those visible", 100 * float(np.isfinite(errors[visible]).mean()), "%")
        _row(table, f"{name}: more than 1 px off", 100 * float((errors[np.isfinite(errors)] > 1).mean()), "%")


def _rate(table: Table, back: _Back) -> None:
    start = back.start(10_000, cloth=False)
    shorter = _Back.__new__(_Back)
    shorter.__dict__ = {**back.__dict__, "n_frames": min(back.n_frames, 12)}
    _, seconds = _followed(shorter, start, Following())
    n = len(start.new.positions)
    _row(table, f"{n} points in three views", seconds, "s a frame", 0.35, False, "CPU of one core, without reading")
    table.add_row("points a second", f"{n / seconds:.0f}", "", "")


def _snakes(table: Table, back: _Back) -> None:
    """Every frame, and every other one: limbs move twice as far from frame to frame."""
    frames, _ = _followed(back, back.start(3000, step_px=6), Following())
    for stride in (1, 2):
        table.add_row(f"{50 // stride} frames a second", "", "", "")
        shown = frames[::stride]
        images = [back.images(frame.index)[CENTRE] for frame in shown]
        snakes.add_rows(table, back.truth, back.rig, CENTRE, images, shown)


def _row(
    table: Table, name: str, value: float, unit: str, aim: float | None = None, more: bool = False, note: str = ""
) -> None:
    text = f"{value:.3f} {unit}"
    if aim is None:
        table.add_row(name, text, "", note)
        return
    good = value >= aim if more else value <= aim
    table.add_row(name, f"[{'green' if good else 'red'}]{text}[/]", f"{'>=' if more else '<='} {aim:g}", note)
