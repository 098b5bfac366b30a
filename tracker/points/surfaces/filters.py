"""The two filters of a surface measurement: on the matches, and on the points in space."""

from __future__ import annotations

import numpy as np
import pydantic
from scipy.ndimage import label, uniform_filter

from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.configuration.components import component
from tracker.points.surfaces.growth import MatchField


@component
class NeighbourhoodFilter:
    """Removes matches that differ from the local mean of their neighbours (paper, section 2.2)."""

    window: int = pydantic.Field(default=5, ge=3, le=51)
    """Side of the neighbourhood, cells of the growth grid, odd."""

    max_affine: float = pydantic.Field(default=0.15, gt=0)
    """Largest difference of an affine parameter from the neighbours' mean."""

    max_shift_px: float = pydantic.Field(default=1.0, gt=0)
    """Largest distance from where the neighbours' mean position and affine transformation expect the point, px."""

    min_neighbours: int = pydantic.Field(default=3, ge=1)
    """Matches with fewer neighbours are removed."""

    min_island: int = pydantic.Field(default=30, ge=1)
    """Connected matches of fewer cells are removed: mismatches hang together."""

    rounds: int = pydantic.Field(default=1, ge=0, le=10)
    """How often what was removed is measured again and filtered again."""

    def doubtful(self, field: MatchField) -> Mask:
        """(rows * columns,) matched cells to be removed."""
        matched = field.matched.reshape(field.shape)
        values = np.concatenate([field.at, field.found[:, :6]], axis=1).reshape(*field.shape, 8)
        n, means = _neighbour_means(values, matched, self.window | 1)
        own = values[..., 2:]
        affine = np.abs(own[..., 2:] - means[..., 4:]).max(axis=-1)
        offset = values[..., :2] - means[..., :2]
        expected = means[..., 2:4] + np.einsum("...ij,...j->...i", means[..., 4:].reshape(*field.shape, 2, 2), offset)
        shift = np.linalg.norm(own[..., :2] - expected, axis=-1)
        lonely = n < self.min_neighbours
        away = lonely | (affine > self.max_affine) | (shift > self.max_shift_px)
        doubtful: Mask = matched & (away | self._islands(matched & ~away))
        return doubtful.ravel()

    def _islands(self, matched: Mask) -> Mask:
        """Cells (rows, columns) of small connected regions."""
        regions, _ = label(matched, structure=np.ones((3, 3)))
        small = np.bincount(regions.ravel()) < self.min_island
        small[0] = False
        islands: Mask = small[regions]
        return islands


def _neighbour_means(values: Array, valid: Mask, window: int) -> tuple[Integers, Array]:
    """Number of valid neighbours (rows, columns) in a window, and their means (rows, columns, k), without the cell."""
    weight = valid.astype(np.float64)
    area = window * window

    def summed(layer: Array) -> Array:
        masked = np.where(valid, layer, 0.0)
        sums: Array = uniform_filter(masked, window, mode="constant") * area - masked
        return sums

    count = np.round(summed(weight)).astype(np.int64)
    sums = np.stack([summed(values[..., k]) for k in range(values.shape[-1])], axis=-1)
    return count, sums / np.maximum(count, 1)[..., None]


def voxel_members(points: Array, voxel_m: float) -> Integers:
    """Number (N,) of the voxel that each point (N, 3) lies in, counted from 0 over the voxels that hold any."""
    cells = np.floor((points - points.min(axis=0)) / voxel_m).astype(np.int64)
    _, members = np.unique(cells, axis=0, return_inverse=True)
    return np.asarray(members.ravel(), dtype=np.int64)
