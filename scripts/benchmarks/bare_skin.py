"""Points on the bare skin of the moving back, whose surface is known exactly: the defaults, and settings for skin."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.followed_back import WRONG_MM
from benchmarks.moving_back import CENTRE, VIEWS, Back
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Integers, Mask
from tracker.points.surfaces.surface import SurfaceMeasurement, measure_surface

# What was asked for: times as many points as by the defaults, and their median error, mm.
_AIM_TIMES, _AIM_MM = 5.0, 0.5
# Frames that the settings were not chosen on: that was 10, 25 and 40.
_FRAMES = (0, 20, 30, 50)


def compare(console: Console, skin: SurfaceMeasurement, quick: bool) -> None:
    """Prints a table: for each frame and way of measuring, points and errors on skin and shirt.

    Args:
        console: to print to.
        skin: settings for bare skin.
        quick: one frame.
    """
    back = Back(Path(os.environ["BODYTRACK_DATA"], "closerange"), 51)
    usual = SurfaceMeasurement()
    wallis = replace(usual, preparation=replace(usual.preparation, enhance_contrast=True))
    ways = {"defaults": usual, "with contrast enhanced (Wallis)": wallis, "configs/surfaces/skin.toml": skin}
    table = Table(title="back: points on bare skin, beside the exact surface", title_justify="left")
    columns = ("points", "times", "of cells", "median mm", "95 % mm", f"> {WRONG_MM:g} mm", "error / sigma", "shirt")
    for name in ("frame", "way", *columns):
        table.add_column(name, justify="left" if name == "way" else "right")
    for index in _FRAMES[: 1 if quick else None]:
        first = 0
        for name, way in ways.items():
            with console.status(f"frame {index}: {name}"):
                row, n = _row(back, index, way, first)
            first = first or n
            table.add_row(str(index), name, *row)
        table.add_section()
    table.caption = f"aims on skin: {_AIM_TIMES:g} times the points, median {_AIM_MM:g} mm, none more than 5 mm off"
    console.print(table)


def _row(back: Back, index: int, way: SurfaceMeasurement, first: int) -> tuple[list[str], int]:
    points = measure_surface(way, Frame(index, index / 50, back.images(index)), back.rig).points
    material = back.truth.material(points.pixels[CENTRE], CENTRE, index)
    errors = 1000 * np.linalg.norm(points.points - back.truth.where(material, index), axis=1)
    known, cloth = material[0] >= 0, back.truth.on_cloth(material)
    skin = known & ~cloth
    off, sigma, n = errors[skin], 1000 * points.sigma_m[skin], int(skin.sum())
    median, wrong = float(np.median(off)), int((off > WRONG_MM).sum())
    n_cells = int(_cells(back, index, way.growth.step_px).sum())
    back.truth._cache.clear()
    times = _judged(f"{n / first:.1f}", n >= _AIM_TIMES * first) if first else ""
    shirt = f"{(known & cloth).sum()}, {np.median(errors[known & cloth]):.3f} mm"
    row = [str(n), times, f"{100 * n / n_cells:.0f} %", _judged(f"{median:.3f}", median <= _AIM_MM)]
    row += [f"{np.percentile(off, 95):.2f}", _judged(str(wrong), not wrong), f"{np.median(off / sigma):.2f}", shirt]
    return row, n


def _cells(back: Back, index: int, step_px: int) -> Mask:
    """(N,) cells of the growth grid on skin that all three views show."""
    width, height = back.rig.cameras[CENTRE].size
    rows, columns = np.mgrid[0:height:step_px, 0:width:step_px]
    pixels: Integers = np.stack([columns.ravel(), rows.ravel()], axis=1)
    material = back.truth.material(pixels, CENTRE, index)
    seen = [back.truth.visible(material, index, view) for view in range(len(VIEWS))]
    cells: Mask = np.logical_and.reduce([material[0] >= 0, ~back.truth.on_cloth(material), *seen])
    return cells


def _judged(text: str, good: bool) -> str:
    return f"[{'green' if good else 'red'}]{text}[/]"
