"""Principal strains of a surface from points followed on it, with standard deviations.

A strain gauge is a point with the points around it, in the plane that touches the surface there. Each gauge maps that
plane linearly from the frame of reference to where its points have gone in space. What the map makes of lengths is the
strain; turns and shifts of the body fall out of it. Depths, which cameras beside one another know worst, are smoothed
over the surface first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array, Image, Integers, Mask
from tracker.foundation.files import csv_lines

LEAST_POINTS = 5
"""Points of a gauge, its own among them: three fix a plane map, and two more say how well it fits."""

_FLATTEST = 0.1
"""The least spread of a gauge across, as a share of that along: of points in a line nothing is known across."""

_LEAST = 10
"""Points around from which a curved surface is told: six numbers, and four that say that they fit."""

_WORSE = 2.0
"""A direction is known worst if its standard deviation is so many times that of the next one; else nothing is moved."""

_EDGE_ON = 0.1
"""Least spread of points across, seen along that direction, over that along: a surface seen edge on has no depth."""

_DAMPING = 1e-9
"""Of the normal equations, relative: points in a line have a surface, too."""

_FAR = 3.0
"""Beyond so many robust standard deviations of its residuals a point of a gauge follows something else."""

_WORST = 1e4
"""Condition beyond which the points that a frame shows of a gauge lie in a line."""

_MAD = 1.4826
"""Standard deviation of a normal distribution over the median of its absolute values."""


class Near(NamedTuple):
    """The points around each of N points, at most K."""

    members: Integers
    """(N, K) their rows; its own where there are fewer."""

    there: Mask
    """(N, K) which of them count."""


def near(positions: Array, reach_m: float, least: int = 1) -> Near:
    """The points around each point that is seen, itself among them.

    Args:
        positions: (N, 3) in the frame of reference, metres; NaN where a point is not seen.
        reach_m: how far they are at most.
        least: where there are fewer, none counts.
    """
    seen = np.flatnonzero(np.isfinite(positions[:, 0]))
    found: list[list[int]] = []
    if len(seen):
        found = cKDTree(positions[seen]).query_ball_point(positions[seen], reach_m).tolist()  # type: ignore[attr-defined]
    width = max((len(rows) for rows in found), default=1)
    members = np.tile(np.arange(len(positions))[:, None], (1, width))
    there = np.zeros(members.shape, dtype=np.bool_)
    for row, rows in zip(seen.tolist(), found, strict=True):
        if len(rows) >= least:
            members[row, : len(rows)], there[row, : len(rows)] = seen[rows], True
    return Near(members, there)


@dataclass(frozen=True)
class Gauges:
    """N gauges of at most K points in a frame of reference."""

    members: Integers
    """(N, K) rows of the points; its own where there are fewer."""

    there: Mask
    """(N, K) which of them count."""

    axes: Array
    """(N, 3, 2) unit vectors along the surface, in the world."""

    places: Array
    """(N, K, 2) of the points along them from the gauge's own, metres."""

    distances: Array
    """(N, K, K) between the points, metres."""


def gauges_of(positions: Array, reach_m: float) -> Gauges:
    """The gauges around all points that are seen; those of too few points have none that count.

    Args:
        positions: (N, 3) in the frame of reference, metres; NaN where a point is not seen.
        reach_m: how far the points of a gauge are from its own at most.
    """
    members, there = near(positions, reach_m, LEAST_POINTS)
    around = np.where(there[..., None], positions[members] - positions[:, None], 0.0)
    middle = around.sum(axis=1, keepdims=True) / np.maximum(there.sum(axis=1), 1)[:, None, None]
    centred = np.where(there[..., None], around - middle, 0.0)
    spreads, directions = np.linalg.eigh(centred.transpose(0, 2, 1) @ centred)
    there &= (spreads[:, 1] > _FLATTEST**2 * spreads[:, 2])[:, None]
    axes = directions[:, :, [2, 1]]
    gaps = np.linalg.norm(around[:, :, None] - around[:, None], axis=-1)
    return Gauges(members, there, axes, around @ axes, gaps)


def spacing_m(positions: Array) -> float:
    """The median distance of a point (N, 3) from the one next to it, metres; NaN for fewer than two."""
    seen = positions[np.isfinite(positions[:, 0])]
    return float(np.median(np.asarray(cKDTree(seen).query(seen, k=2)[0])[:, 1])) if len(seen) > 1 else np.nan


def smoothed(positions: Array, covariances: Array, around: Near) -> Array:
    """Points moved along the direction in which they are known worst, onto a curved surface through those around.

    Lateral places, which matching knows six times as well, stay. Points with too few around them stay as well.

    Args:
        positions: (N, 3) of a frame, metres; NaN where a point is not seen.
        covariances: (N, 3, 3) of them.
        around: the points around each in the frame of reference.
    """
    known: Mask = np.isfinite(positions[:, 0]) & np.isfinite(covariances[:, 0, 0])
    variances, axes = np.linalg.eigh(np.where(known[:, None, None], covariances, np.eye(3)))
    known &= variances[:, 2] > _WORSE**2 * variances[:, 1]
    there = around.there & np.isfinite(positions[:, 0])[around.members] & known[:, None]
    gone = np.where(there[..., None], positions[around.members] - positions[:, None], 0.0) @ axes
    size = np.sqrt((gone[..., :2] ** 2).sum(axis=(1, 2)) / np.maximum(there.sum(axis=1), 1)) + 1e-12
    u, v = (gone[..., :2] / size[:, None, None]).transpose(2, 0, 1)
    design = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=2) * there[..., None]
    normal = design.transpose(0, 2, 1) @ design
    normal += (_DAMPING * np.trace(normal, axis1=1, axis2=2) + 1e-12)[:, None, None] * np.eye(6)
    depth = np.linalg.solve(normal, design.transpose(0, 2, 1) @ gone[..., 2:])[:, 0, 0]
    spreads = np.linalg.eigvalsh(np.einsum("nki,nkj->nij", gone[..., :2], gone[..., :2]))
    told = (there.sum(axis=1) >= _LEAST) & (spreads[:, 0] > _EDGE_ON**2 * spreads[:, 1])
    depth = np.where(told, depth, 0.0)
    moved: Array = positions + axes[:, :, 2] * depth[:, None]
    return moved


@dataclass(frozen=True)
class Strains:
    """Of N gauges; NaN where a frame does not show enough of one."""

    stretches: Array
    """(N, 2) principal strains, the larger one first: change of a length over the length."""

    sigmas: Array
    """(N, 2) their standard deviations."""

    directions: Array
    """(N, 3) unit vector of the larger one, in the frame looked at, in the world."""

    counts: Integers
    """(N,) points that took part."""

    @property
    def shear(self) -> Array:
        """(N,) largest change of a right angle on the surface, rad: the difference of the two."""
        found: Array = self.stretches[:, 0] - self.stretches[:, 1]
        return found

    @property
    def shear_sigmas(self) -> Array:
        """(N,) standard deviations of the shear, rad."""
        found: Array = np.hypot(*self.sigmas.T)
        return found


def strains_of(gauges: Gauges, positions: Array, patch_m: float) -> Strains:
    """The strains between the frame of reference and another one.

    Points closer than a patch share a part of its pixels, and so of its error, which therefore hardly changes the
    distance between them: their correlation is taken to be the share of the patch that they have in common.

    Args:
        gauges: in the frame of reference.
        positions: (N, 3) in the other one, metres; NaN where a point is not seen.
        patch_m: width of the patches that the points were matched by, on the surface, metres; 0 for independent errors.
    """
    there = gauges.there & np.isfinite(positions[:, 0])[gauges.members]
    there &= np.isfinite(positions[:, 0])[:, None]
    gone = np.nan_to_num(positions[gauges.members] - positions[:, None])
    design = np.concatenate([np.ones((*there.shape, 1)), gauges.places], axis=2)
    maps, _ = _fitted(design, gone, there)
    there = _without_far(design, gone, there, maps)
    maps, inverse = _fitted(design, gone, there)
    known: Mask = there.sum(axis=1) >= LEAST_POINTS
    lengths, across = np.linalg.eigh(maps[:, 1:] @ maps[:, 1:].transpose(0, 2, 1))
    stretched = np.sqrt(np.maximum(lengths[:, ::-1], 0.0))
    across = across[:, :, ::-1]
    # (N, 3, 2) where the two principal directions have gone, unit vectors
    along = np.einsum("nuk,nui->nik", across, maps[:, 1:]) / np.maximum(stretched, 1e-9)[:, None]
    overlaps = _shared(gauges.distances, patch_m) * (there[:, :, None] & there[:, None])
    weighted = design * there[..., None]
    spread = inverse @ (weighted.transpose(0, 2, 1) @ overlaps @ weighted) @ inverse
    # of white noise of variance 1 so much is left in the residuals: they tell its true variance
    left = np.trace(overlaps, axis1=1, axis2=2) - np.trace(spread @ _normal(weighted), axis1=1, axis2=2)
    residuals = np.where(there[..., None], gone - design @ maps, 0.0)
    squares = np.einsum("nki,nij->nkj", residuals, along)
    variances = _smoothed((squares**2).sum(axis=1), left, gauges, known)
    turned = np.einsum("nuk,nuw,nwk->nk", across, spread[:, 1:, 1:], across)
    sigmas = np.sqrt(variances * np.maximum(turned, 0.0))
    nothing = np.where(known, 1.0, np.nan)[:, None]
    return Strains(
        (stretched - 1) * nothing, sigmas * nothing, along[:, :, 0] * nothing, np.where(known, there.sum(1), 0)
    )


def _normal(weighted: Array) -> Array:
    found: Array = weighted.transpose(0, 2, 1) @ weighted
    return found


def _fitted(design: Array, gone: Array, there: Mask) -> tuple[Array, Array]:
    """(N, 3, 3) least squares maps, an offset and two columns of the plane's map, and inverse normal matrices."""
    weighted = design * there[..., None]
    normal = _normal(weighted)
    # of too few points nothing is said: any regular matrix will do
    few = (there.sum(axis=1) < LEAST_POINTS) | (np.linalg.cond(normal / _scale(normal)) > _WORST)
    normal = np.where(few[:, None, None], np.eye(3), normal)
    inverse = np.linalg.inv(normal).astype(np.float64)
    there[few] = False
    maps: Array = inverse @ (weighted.transpose(0, 2, 1) @ gone)
    return maps, inverse


def _scale(normal: Array) -> Array:
    """(N, 3, 3) what makes the diagonals 1: metres and numbers are not compared."""
    roots = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-12))
    found: Array = roots[:, :, None] * roots[:, None]
    return found


def _without_far(design: Array, gone: Array, there: Mask, maps: Array) -> Mask:
    """(N, K) points that go with the others of their gauge."""
    off = np.where(there, np.linalg.norm(gone - design @ maps, axis=2), np.nan)
    order = np.sort(off, axis=1)
    counts = there.sum(axis=1)
    middle = np.take_along_axis(order, np.maximum((counts - 1) // 2, 0)[:, None], axis=1)
    # a residual has three axes: its median is larger than that of one
    kept: Mask = there & ~(off > _FAR * _MAD * middle)
    enough: Mask = kept.sum(axis=1) >= LEAST_POINTS
    return np.where(enough[:, None], kept, there)


def _shared(distances: Array, patch_m: float) -> Array:
    """What two patches have in common: the share of a square at these distances, along its diagonal."""
    if patch_m <= 0:
        alone: Array = (distances == 0).astype(np.float64)
        return alone
    found: Array = np.maximum(1 - distances / (np.sqrt(2) * patch_m), 0.0) ** 2
    return found


def _smoothed(squares: Array, left: Array, gauges: Gauges, known: Mask) -> Array:
    """(N, 2) variance of a coordinate, over the members of each gauge: one alone has few residuals to tell it."""
    use = gauges.there & known[gauges.members]
    total = (squares[gauges.members] * use[..., None]).sum(axis=1)
    weight = (np.maximum(left, 0.0)[gauges.members] * use).sum(axis=1)
    found: Array = total / np.maximum(weight, 1e-12)[:, None]
    return found


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
