"""Points followed on a moving back whose surface is known exactly, beside pyramidal Lucas-Kanade."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks import hidden_back, snakes, strained_back
from benchmarks.followed_back import N_POINTS, add_row, errors_of, followed
from benchmarks.moving_back import CENTRE, VIEWS, Back, Start
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.cameras.triangulation import triangulate
from tracker.points.following.births import chosen_evenly, points_of_image, points_of_surface
from tracker.points.following.following import Following
from tracker.points.following.sequence import follow
from tracker.points.surfaces.growth import Growth
from tracker.points.surfaces.surface import Preparation, SurfaceMeasurement, measure_surface
from tracker.points.trajectories import PointFrame, PointStatus


def compare(console: Console, only: str, quick: bool) -> None:
    """Prints a table for each question; quick: few frames."""
    cv2.setNumThreads(1)
    if "BODYTRACK_DATA" not in os.environ:
        console.print("BODYTRACK_DATA is not set: no recordings to follow points on")
        return
    back = Back(Path(os.environ["BODYTRACK_DATA"], "closerange"), 5 if quick else 51)
    parts = {
        "shirt": _shirt,
        "hidden": hidden_back.add_rows,
        "interlaced": _interlaced,
        "flat": _flat,
        "rate": _rate,
        "snakes": _snakes,
        "strain": strained_back.add_rows,
    }
    for name, part in parts.items():
        if only in name:
            table = Table(
                "", "measured", "aim", "", title=f"back, {back.n_frames} frames: {name}", title_justify="left"
            )
            part(table, back)
            console.print(table)


def _shirt(table: Table, back: Back) -> None:
    start = back.start(N_POINTS)
    frames, _ = followed(back, start, Following())
    ours = errors_of(start, frames[-1])
    ours.rows(table, "key patches")
    sigma = 1000 * np.sqrt(np.trace(frames[-1].covariances, axis1=1, axis2=2))
    table.add_row("error / sigma, median", f"{np.nanmedian(ours.distance_mm / sigma):.2f}", "", "three axes together")
    status = np.stack([frame.status for frame in frames])
    table.add_row("keys replaced", str(int((status == PointStatus.REKEYED).sum())), "", "of points, in all frames")
    before = Following(template="previous", start="correlation")
    theirs = errors_of(start, followed(back, start, before)[0][-1])
    theirs.rows(table, "previous frame's patches, correlation (the paper)", judged=False)
    flow = errors_of(start, _lucas_kanade(back, start))
    flow.rows(table, "Lucas-Kanade and ray intersection", judged=False)
    add_row(table, "Lucas-Kanade's median error / ours", flow.median_mm / ours.median_mm, "", 3.0, True)


def _lucas_kanade(back: Back, start: Start) -> PointFrame:
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


def _interlaced(table: Table, back: Back) -> None:
    start = back.start(N_POINTS)
    progressive = errors_of(start, followed(back, start, Following())[0][-1])
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
    errors = errors_of(own, last)
    add_row(table, "odd lines, 25 Hz: median error", errors.median_mm, "mm")
    add_row(table, "left of those visible throughout", errors.left, "%")
    add_row(table, "median error / progressive's", errors.median_mm / progressive.median_mm, "", 1.4)


def _flat(table: Table, back: Back) -> None:
    start, camera = back.start(N_POINTS), back.rig.cameras[CENTRE]
    new, visible = points_of_image(start.new.pixels[CENTRE]), start.visible[:, CENTRE].all(axis=0)
    usual = Following().for_views(1)
    for following in (usual, replace(usual, matching=usual.matching.with_patch(21))):
        patch_px = following.matching.patch_px
        frames = (replace(frame, images=frame.images[CENTRE : CENTRE + 1]) for frame in back.frames())
        *_, (last, _) = follow(following, Preparation(), Rig((camera,)), frames, lambda frame: new)
        errors = np.linalg.norm(last.pixels[0] - camera.project(start.positions[last.index]), axis=1)
        name = f"centre view alone, {patch_px} px patches"
        add_row(table, f"{name}: median error", float(np.nanmedian(errors)), "px", 0.07)
        add_row(table, f"{name}: left of those visible", 100 * float(np.isfinite(errors[visible]).mean()), "%")
        add_row(table, f"{name}: more than 1 px off", 100 * float((errors[np.isfinite(errors)] > 1).mean()), "%")


def _rate(table: Table, back: Back) -> None:
    start = back.start(10_000, cloth=False)
    _, seconds = followed(back.first(12), start, Following())
    n = len(start.new.positions)
    add_row(table, f"{n} points in three views", seconds, "s a frame", 0.35, False, "CPU of one core, without reading")
    table.add_row("points a second", f"{n / seconds:.0f}", "", "")


def _snakes(table: Table, back: Back) -> None:
    """Every frame, and every other one: limbs move twice as far from frame to frame."""
    frames, _ = followed(back, back.start(3000, step_px=6), Following())
    for stride in (1, 2):
        table.add_row(f"{50 // stride} frames a second", "", "", "")
        shown = frames[::stride]
        images = [back.images(frame.index)[CENTRE] for frame in shown]
        snakes.add_rows(table, back.truth, back.rig, CENTRE, images, shown)
