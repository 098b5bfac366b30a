"""Growth of matches from seeds over a grid of the template image (D'Apuzzo et al. 2000, section 2.2, figure 3)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pydantic
from scipy.ndimage import uniform_filter
from scipy.spatial import cKDTree

from tracker.foundation.arrays import Array, Integers, Mask, frozen
from tracker.foundation.configuration.components import component
from tracker.foundation.progress import Progress, silent
from tracker.kernels.patches import HALF_PATCH, MATCHED, N_FOUND, UNTRIED, Grid, Heap, grow, push_all
from tracker.points.surfaces import FAILURES, LeastSquaresMatching, Matches, PatchImage

# So that progress is told, and Ctrl-C heard, again and again.
_ATTEMPTS_A_CALL = 20_000
# Region of a point that must not grow; -1 is one without a seed.
_OUTSIDE_REGION = -2


@dataclass(frozen=True)
class MatchField:
    """Matches of one search image on a grid over the template image."""

    step_px: int
    """From one cell to the next; cell (0, 0) is pixel (0, 0)."""

    shape: tuple[int, int]
    """Rows and columns."""

    found: Array
    """(rows * columns, 15) columns as in `tracker.kernels.patches`; meaningless where not matched."""

    ended: Integers
    """(rows * columns,) how each match ended, 0 for a match, -1 where none was tried."""

    @staticmethod
    def empty(size: tuple[int, int], step_px: int) -> MatchField:
        """No match on the grid over an image of that width and height."""
        columns, rows = (size[0] - 1) // step_px + 1, (size[1] - 1) // step_px + 1
        found = frozen(np.zeros((rows * columns, N_FOUND)))
        return MatchField(step_px, (rows, columns), found, frozen(np.full(rows * columns, UNTRIED), np.int64))

    @property
    def matched(self) -> Mask:
        """(rows * columns,) cells with a match."""
        matched: Mask = self.ended == MATCHED
        return matched

    @property
    def at(self) -> Array:
        """(rows * columns, 2) template pixels of the cells."""
        rows, columns = np.divmod(np.arange(len(self.ended)), self.shape[1])
        return np.stack([columns, rows], axis=1).astype(np.float64) * self.step_px

    @property
    def matches(self) -> Matches:
        """All cells as matches."""
        return Matches(self.at, self.found, self.ended)

    def without(self, cells: Mask) -> MatchField:
        """The field with those cells (rows * columns,) open again."""
        ended = np.where(cells, UNTRIED, self.ended)
        return MatchField(self.step_px, self.shape, self.found, frozen(ended, np.int64))

    def cells_of(self, pixels: Array) -> Integers:
        """Cells (N,) nearest to template pixels (N, 2)."""
        columns, rows = np.round(pixels / self.step_px).astype(np.int64).T
        cells: Integers = np.clip(rows, 0, self.shape[0] - 1) * self.shape[1] + np.clip(columns, 0, self.shape[1] - 1)
        return cells


@component
class Growth:
    """Matches spread from the seeds to their neighbours, as far as their quality is good."""

    step_px: int = pydantic.Field(default=3, ge=1, le=50)
    """Distance of neighbouring points in the template image, px."""

    order: Literal["best_first", "rows"] = "best_first"
    """`best_first` goes on from the most precise match; `rows` from each seed first horizontally, then vertically."""

    retry_patch_px: int | None = pydantic.Field(default=21, ge=5, le=63)
    """Larger patch for points that the usual one fails on, after smaller shifts from the neighbour; None for none."""

    max_tries: int = pydantic.Field(default=2, ge=1)
    """Neighbours from which a point is tried before it is given up; 4 closes most holes and takes longest."""

    max_sigma0_grey: float = pydantic.Field(default=12.0, gt=0)
    """Matches with a larger a-posteriori standard deviation of unit weight are rejected, grey levels."""

    max_sigma_px: float = pydantic.Field(default=0.1, gt=0)
    """Matches with a larger standard deviation of the shift in x or y are rejected, px."""

    min_correlation: float = pydantic.Field(default=0.85, ge=0, le=1)
    """Matches whose patches agree less are rejected."""

    max_stretch: float = pydantic.Field(default=2.5, gt=1)
    """Matches whose patch is stretched or compressed more are rejected: the surface is too oblique to one camera."""

    region: tuple[int, int, int, int] | None = None
    """Only points in this rectangle of the template are measured: left, top, right, bottom, px; None for all."""

    @pydantic.field_validator("region")
    @classmethod
    def _check_region(cls, region: tuple[int, int, int, int] | None) -> tuple[int, int, int, int] | None:
        if region is not None and (region[0] >= region[2] or region[1] >= region[3]):
            raise ValueError(f"region = {list(region)}: expected left < right and top < bottom, px")
        return region

    def inside(self, at: Array) -> Mask:
        """(N,) template pixels (N, 2) in the region."""
        if self.region is None:
            return np.ones(len(at), dtype=np.bool_)
        left, top, right, bottom = self.region
        inside: Mask = np.asarray(((at >= (left, top)) & (at <= (right, bottom))).all(axis=1))
        return inside

    def good(self, matches: Matches) -> Mask:
        """(N,) matches within the limits of quality."""
        precise = (matches.sigmas <= self.max_sigma_px).all(axis=1)
        alike = (matches.sigma0 <= self.max_sigma0_grey) & (matches.correlation >= self.min_correlation)
        good: Mask = matches.good & precise & alike & (matches.stretch <= self.max_stretch) & self.inside(matches.at)
        return good

    def faults(self, matches: Matches) -> list[str]:
        """(N,) what is wrong with each match, in words; empty for good ones."""
        limits = (
            (~self.inside(matches.at), "outside growth.region"),
            (matches.correlation < self.min_correlation, "patches agree too little (min_correlation)"),
            (matches.stretch > self.max_stretch, "stretched too much (max_stretch)"),
            (matches.sigma0 > self.max_sigma0_grey, "grey levels differ too much (max_sigma0_grey)"),
            ((matches.sigmas > self.max_sigma_px).any(axis=1), "not precise enough (max_sigma_px)"),
        )
        faults = np.select([bad for bad, _ in limits], [words for _, words in limits], "")
        ended = (FAILURES.get(int(code), "") for code in matches.ended)
        return [failure or str(fault) for failure, fault in zip(ended, faults, strict=True)]

    def grown(
        self,
        matching: LeastSquaresMatching,
        images: tuple[PatchImage, PatchImage],
        seeds: Matches,
        progress: Progress = silent,
        measured: MatchField | None = None,
    ) -> MatchField:
        """Grows from seeds, then closes holes from all directions.

        Args:
            matching: finds each point.
            images: template and search image.
            seeds: good matches at cells of the grid.
            progress: gets the number of matched points from time to time.
            measured: what is matched already and stays so.
        """
        field = measured or MatchField.empty(images[0].size, self.step_px)
        found, ended = np.array(field.found), np.array(field.ended)
        seeds = seeds.select(~field.matched[field.cells_of(seeds.at)])
        cells = field.cells_of(seeds.at)
        found[cells], ended[cells] = seeds.found, MATCHED
        field = MatchField(self.step_px, field.shape, frozen(found), frozen(ended, np.int64))
        if self.order == "rows" and len(cells):
            _, nearest = cKDTree(field.at[cells]).query(field.at)
            field = self._spread(matching, images, field, cells[nearest], progress)
        return self.continued(matching, images, field, progress)

    def continued(
        self,
        matching: LeastSquaresMatching,
        images: tuple[PatchImage, PatchImage],
        field: MatchField,
        progress: Progress = silent,
    ) -> MatchField:
        """Measures open cells beside matched ones, from all directions; see `grown`."""
        return self._spread(matching, images, field, np.full(len(field.ended), -1), progress)

    def _spread(
        self,
        matching: LeastSquaresMatching,
        images: tuple[PatchImage, PatchImage],
        field: MatchField,
        regions: Integers,
        progress: Progress,
    ) -> MatchField:
        rows, columns = field.shape
        grid: Grid = columns, rows, field.step_px
        found, ended = np.array(field.found), np.array(field.ended)
        # Growth stays in its region: cells outside are of one that nothing starts in.
        regions = np.where(self.inside(field.at), regions, _OUTSIDE_REGION)
        room = 4 * len(ended) + 4
        heap: Heap = np.zeros(room), np.zeros(room, dtype=np.int64), np.zeros(1, dtype=np.int64)
        state = found, ended, regions.astype(np.int64), np.zeros(len(ended), dtype=np.int64)
        push_all(heap, grid, *state[:3])
        rules = matching.rule, matching.with_patch(self.retry_patch_px or matching.patch_px).rule
        judging = matching.noise, (self.max_sigma0_grey, self.max_sigma_px, self.min_correlation, self.max_stretch)
        packed, left = (images[0].packed, images[1].packed), 1
        while left:
            left = grow(packed, grid, state, heap, rules, judging, (_ATTEMPTS_A_CALL, self.max_tries))
            progress("points matched", int((ended == MATCHED).sum()), len(ended))
        return MatchField(field.step_px, field.shape, frozen(found), frozen(ended, np.int64))


# A larger correction is no curvature but a wrong neighbour; a plane has three unknowns.
_LARGEST_PX = 0.5
_MIN_NEIGHBOURS = 9


def corrected_for_curvature(field: MatchField, where_consistent: bool = True) -> MatchField:
    """Shifts every match from the mean of its patch to the patch's centre.

    The least squares shift is the mean over the patch of the true shift s, which on a curved surface is not that
    of the centre: by Taylor's theorem ``mean(s) - s(0) = (s_xx + s_yy) m / 2``, with m the mean square of the pixels'
    offsets along an axis. The second derivatives are the slopes of the matched affine terms over the neighbours
    within a patch's reach (after Schreier and Sutton 2002, systematic errors due to undermatched shape functions).
    Corrections above half a pixel are steps between surfaces and not made.

    A smooth surface asks for nearly one correction all over a patch; noise and rough surfaces ask for others at every
    cell. Where consistency counts, each correction is multiplied by the Wiener weight ``|mean c|^2 / mean |c|^2`` over
    the patch's reach. Measured against truth, never / always / weighted: a back at 13 px patches 0.195 / 0.167 /
    0.162 mm and at 21 px 0.334 / 0.129 / 0.130 mm; rays of the rough temple 0.055 / 0.062 / 0.057 px.

    Args:
        field: filtered matches.
        where_consistent: weigh the corrections so; otherwise all are made in full.

    Returns:
        The same matches with corrected positions.
    """
    matched = field.matched.reshape(field.shape)
    if not matched.any():
        return field
    half = field.found[:, HALF_PATCH].reshape(field.shape)
    window = 2 * max(2, round(float(np.median(half[matched])) / field.step_px)) + 1
    affine = field.found[:, 2:6].reshape(*field.shape, 4)
    x, y = field.at.reshape(*field.shape, 2).transpose(2, 0, 1)
    n, slopes = _slopes(matched, affine, (x, y), window)
    mean_square = half * (half + 1) / 3
    shift = 0.5 * mean_square[..., None] * slopes
    usable = matched & (n >= _MIN_NEIGHBOURS) & (np.abs(shift).max(axis=-1) <= _LARGEST_PX)
    if where_consistent:
        shift = shift * _consistency(usable, shift, window)[..., None]
    found = np.array(field.found)
    found[:, :2] -= np.where(usable[..., None], shift, 0.0).reshape(-1, 2)
    return replace(field, found=frozen(found))


def _slopes(valid: Mask, affine: Array, axes: tuple[Array, Array], window: int) -> tuple[Array, Array]:
    """Numbers of neighbours (rows, columns), and ``s_xx + s_yy`` of both shifts (rows, columns, 2)."""
    n = _summed(valid, np.ones(valid.shape), window)
    count = np.maximum(n, 1)

    def slope(values: Array, along: Array) -> Array:
        mean, centre = _summed(valid, values, window) / count, _summed(valid, along, window) / count
        mixed = _summed(valid, values * along, window) / count - mean * centre
        spread = _summed(valid, along * along, window) / count - centre * centre
        return np.where(spread > _NO_SPREAD, mixed / np.maximum(spread, _NO_SPREAD), 0.0)

    x, y = (axis - axis.mean() for axis in axes)
    second = [slope(affine[..., k], x) + slope(affine[..., k + 1], y) for k in (0, 2)]
    return n, np.stack(second, axis=-1)


# px^2: neighbours within half a pixel tell no slope.
_NO_SPREAD = 0.25


def _consistency(usable: Mask, shift: Array, window: int) -> Array:
    """(rows, columns) weights 0 to 1: how far the shifts (rows, columns, 2) around a cell are one and the same."""
    count = np.maximum(_summed(usable, np.ones(usable.shape), window), 1)
    mean = np.stack([_summed(usable, shift[..., k], window) / count for k in range(2)], axis=-1)
    square = _summed(usable, (shift**2).sum(axis=-1), window) / count
    weights: Array = np.clip((mean**2).sum(axis=-1) / np.maximum(square, _NO_SHIFT_PX2), 0.0, 1.0)
    return weights


# Keeps 0 / 0 away.
_NO_SHIFT_PX2 = 1e-12


def _summed(valid: Mask, values: Array, window: int) -> Array:
    """Sums over the valid cells of a window around each cell."""
    sums: Array = uniform_filter(np.where(valid, values, 0.0), window, mode="constant") * window * window
    return sums
