"""Strains as a table and as colours over an image."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array, Image, Integers, Mask
from tracker.foundation.files import csv_lines
from tracker.points.strain.strains import Strains

COLUMNS = (
    *("frame", "time_s", "point", "x_m", "y_m", "z_m", "stretch_1", "sigma_1", "stretch_2", "sigma_2"),
    *("shear_rad", "sigma_shear_rad", "direction_x", "direction_y", "direction_z", "points"),
)
"""Of `strain.csv`."""

_WIDTH_INCH, _DOT = 5.0, 1.4
"""Width of a picture, and of a point in it over the distance of the points."""

_PANEL = 0.83
"""Share of a picture's width that its scale leaves."""

_MOST_TICKS = 400
"""Directions that are drawn: more hide the colours."""

_MARGIN = 0.08
"""What is shown around the points, share of their extent."""


class StrainFrame(NamedTuple):
    """The strains of a frame."""

    frame: int
    time_s: float
    positions: Array
    """(N, 3) where its points are, metres."""

    strains: Strains


def strain_lines(ids: Integers, one: StrainFrame) -> Iterator[str]:
    """A row for each point that a gauge lies around; see `COLUMNS`.

    Args:
        ids: (N,) numbers of the points.
        one: the frame.
    """
    found = one.strains
    for n in np.flatnonzero(np.isfinite(found.stretches[:, 0])):
        pairs = zip(found.stretches[n], found.sigmas[n], strict=True)
        numbers = [*(value for pair in pairs for value in pair), found.shear[n], found.shear_sigmas[n]]
        place = [f"{value:.6f}" for value in one.positions[n]]
        told = [f"{value:.5f}" for value in [*numbers, *found.directions[n]]]
        yield csv_lines([[one.frame, f"{one.time_s:.6f}", ids[n], *place, *told, found.counts[n]]])


def strain_figure(one: StrainFrame, camera: Camera, image: Image | None, ends: tuple[float, float]) -> Figure:
    """Larger and smaller principal strain and shear as colours of the points over an image.

    Args:
        one: the frame.
        camera: of the image.
        image: (h, w, 3) BGR or (h, w); None for none.
        ends: largest principal strain and shear that colours tell.
    """
    found = one.strains
    known: Mask = np.isfinite(found.stretches[:, 0])
    pixels = camera.project(one.positions[known])
    left, top, right, bottom = _window(pixels, camera.size)
    height = _WIDTH_INCH * (bottom - top) / (right - left) + 1.2
    figure = Figure((3 * _WIDTH_INCH, height), layout="constrained")
    panels = (
        ("larger principal strain, %", 100 * found.stretches[known, 0], "RdBu_r", (-100 * ends[0], 100 * ends[0])),
        ("smaller principal strain, %", 100 * found.stretches[known, 1], "RdBu_r", (-100 * ends[0], 100 * ends[0])),
        ("shear, degrees", np.degrees(found.shear[known]), "viridis", (0.0, float(np.degrees(ends[1])))),
    )
    for n, (axis, (title, values, colours, limits)) in enumerate(zip(figure.subplots(1, 3), panels, strict=True)):
        if image is not None:
            grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
            axis.imshow(grey, cmap="gray", vmin=0, vmax=400)
        size = (_DOT * _spacing_px(pixels) * 72 * _PANEL * _WIDTH_INCH / (right - left)) ** 2
        drawn = axis.scatter(*pixels.T, c=values, s=size, cmap=colours, vmin=limits[0], vmax=limits[1], linewidths=0)
        if n < 2:
            _draw_directions(axis, one, camera, known, n)
        axis.set(xlim=(left, right), ylim=(bottom, top), title=title, xticks=[], yticks=[], aspect="equal")
        figure.colorbar(drawn, ax=axis, shrink=0.7)
    figure.suptitle(f"frame {one.frame}, {one.time_s:.2f} s; median sigma {100 * _median(found.sigmas[known]):.2f} %")
    return figure


def _median(values: Array) -> float:
    return float(np.median(values)) if values.size else np.nan


def _draw_directions(axis: Axes, one: StrainFrame, camera: Camera, known: Mask, which: int) -> None:
    """Short lines along the principal direction at some of the points that are strained for sure."""
    found = one.strains
    sure = np.flatnonzero(known & (np.abs(found.stretches[:, which]) > 3 * found.sigmas[:, which]))
    sure = sure[:: max(1, len(sure) // _MOST_TICKS)]
    if not len(sure):
        return
    towards = camera.centre - one.positions[sure]
    # the smaller one lies across the larger one on the surface, which faces the camera more or less
    along = found.directions[sure] if which == 0 else np.cross(found.directions[sure], towards)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    ends = np.stack([camera.project(one.positions[sure] + sign * _TICK_M * along) for sign in (-1, 1)])
    axis.plot(*ends.transpose(2, 0, 1), color="black", linewidth=0.5)


_TICK_M = 0.006
"""Half a tick, metres."""


def _window(pixels: Array, size: tuple[int, int]) -> tuple[float, float, float, float]:
    if not len(pixels):
        return 0.0, 0.0, float(size[0]), float(size[1])
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    margin = _MARGIN * float((high - low).max()) + 4
    left, top = np.maximum(low - margin, 0.0)
    right, bottom = np.minimum(high + margin, size)
    return float(left), float(top), max(float(right), left + 8.0), max(float(bottom), top + 8.0)


def _spacing_px(pixels: Array) -> float:
    """About how far the points are apart."""
    if len(pixels) < 2:
        return 1.0
    extent = np.ptp(pixels, axis=0)
    return float(np.sqrt(extent[0] * extent[1] / len(pixels)))
