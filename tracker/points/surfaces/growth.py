"""Growth of matches from seeds over a grid of the template image (D'Apuzzo et al. 2000, section 2.2, figure 3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pydantic
from scipy.spatial import cKDTree

from tracker.foundation.arrays import Array, Integers, Mask, frozen
from tracker.foundation.configuration.components import component
from tracker.foundation.progress import Progress, silent
from tracker.kernels.patches import MATCHED, N_FOUND, UNTRIED, Grid, Heap, grow, push_all
from tracker.points.surfaces.matching import FAILURES, LeastSquaresMatching, Matches, PatchImage

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
            progress: told the number of matched points from time to time.
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
