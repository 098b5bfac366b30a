"""Points in space from matched points, the filters of both, and how much of the views they cover."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pydantic
from scipy.ndimage import label, uniform_filter
from scipy.spatial import cKDTree

from tracker.cameras.camera import Camera
from tracker.cameras.triangulation import triangulate
from tracker.foundation.arrays import Array, Image, Integers, Mask
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
    """Number of times that removed points are measured and filtered again."""

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


# Points in space from matched points: forward ray intersection with covariances, and the voxel filter.


@dataclass(frozen=True)
class SurfacePoints:
    """N measured points of a surface."""

    points: Array
    """(N, 3) in the world, metres."""

    covariances: Array
    """(N, 3, 3) m^2, from the matching's own precision times the variance factor s0^2 where that exceeds 1."""

    pixels: Array
    """(V, N, 2) in all views, px; NaN where a view does not show the point."""

    residual_px: Array
    """(N,) RMS of the reprojection over the coordinates of the views that show the point, px."""

    colours: Image
    """(N, 3) BGR of the template."""

    s0: float
    """A-posteriori standard deviation of unit weight of all ray intersections; 1 where matching and rig are perfect."""

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def sigma_m(self) -> Array:
        """(N,) point error: root of the sum of the three variances, metres."""
        deviations: Array = np.sqrt(np.trace(self.covariances, axis1=1, axis2=2))
        return deviations

    @cached_property
    def n_views(self) -> Integers:
        """(N,) views that show each point."""
        count: Integers = np.isfinite(self.pixels[..., 0]).sum(axis=0)
        return count

    def select(self, which: Mask | Integers) -> SurfacePoints:
        """The chosen points."""
        return SurfacePoints(
            self.points[which],
            self.covariances[which],
            self.pixels[:, which],
            self.residual_px[which],
            self.colours[which],
            self.s0,
        )


def intersect(
    cameras: Sequence[Camera],
    template: int,
    fields: Sequence[MatchField | None],
    min_views: int,
    max_residual_px: float = np.inf,
) -> SurfacePoints:
    """Forward ray intersection of the points matched in enough views.

    A match compares two noisy images: half its covariance is the template's, half the search image's.

    Args:
        cameras: the V views.
        template: index of the view that the grid lies in.
        fields: matches of each view, None for the template.
        min_views: views that must show a point, the template included.
        max_residual_px: points with a larger RMS of the reprojection are mismatches and left out, px.

    Returns:
        The points before the cameras, still without colours.
    """
    searched = [v for v in range(len(cameras)) if v != template]
    matched = np.array([fields[v].matched for v in searched])  # type: ignore[union-attr]
    cells = np.flatnonzero(matched.sum(axis=0) + 1 >= min_views)
    pixels = np.full((len(cameras), len(cells), 2), np.nan)
    variances = np.full((len(cameras), len(cells), 2, 2), np.nan)
    for v in searched:
        field = fields[v]
        assert field is not None
        own = field.matched[cells]
        pixels[v, own] = field.found[cells[own], :2]
        variances[v, own] = field.matches.covariances[cells[own]] / 2
        pixels[template] = field.at[cells]
    if len(cells):
        variances[template] = np.nanmean(variances[searched], axis=0)
    return _intersected(cameras, pixels, variances, max_residual_px)


def _intersected(cameras: Sequence[Camera], pixels: Array, variances: Array, max_residual_px: float) -> SurfacePoints:
    start, _ = triangulate(cameras, pixels)
    points, normal, squares = _adjusted(cameras, pixels, variances, start)
    residual, seen = _residuals(cameras, pixels, points)
    with np.errstate(invalid="ignore"):
        rms = np.sqrt((residual**2).sum(axis=(0, 2)) / (2 * seen.sum(axis=0)))
        kept = (seen.sum(axis=0) >= 2) & (rms <= max_residual_px)
    redundancy = (2 * seen.sum(axis=0) - 3)[kept].sum()
    s0 = float(np.sqrt(squares[kept].sum() / max(redundancy, 1)))
    covariances = np.full_like(normal, np.nan)
    covariances[kept] = np.linalg.inv(normal[kept]) * max(1.0, s0) ** 2
    colours = np.zeros((len(points), 3), dtype=np.uint8)
    return SurfacePoints(points, covariances, pixels, rms, colours, s0).select(kept)


def _adjusted(
    cameras: Sequence[Camera], pixels: Array, variances: Array, points: Array, n_iterations: int = 3
) -> tuple[Array, Array, Array]:
    """Gauss-Newton on the weighted reprojection error.

    Returns:
        Points (N, 3), their normal matrices (N, 3, 3), and weighted sums of squares (N,).
    """
    for last in (*[False] * n_iterations, True):
        normal, gradient, squares = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3)), np.zeros(len(points))
        residuals, seen = _residuals(cameras, pixels, points)
        for v, camera in enumerate(cameras):
            weight = np.zeros((len(points), 2, 2))
            weight[seen[v]] = np.linalg.inv(variances[v, seen[v]])
            jacobian = np.where(seen[v][:, None, None], camera.project_jacobian(points), 0.0)
            weighted = np.swapaxes(jacobian, 1, 2) @ weight
            normal += weighted @ jacobian
            gradient += np.einsum("nij,nj->ni", weighted, residuals[v])
            squares += np.einsum("ni,nij,nj->n", residuals[v], weight, residuals[v])
        regular = np.isfinite(points).all(axis=1) & (seen.sum(axis=0) >= 2)
        normal[~regular] = np.eye(3)
        if not last:
            points = points + np.linalg.solve(normal, gradient[..., None])[..., 0]
    return points, normal, squares


def _residuals(cameras: Sequence[Camera], pixels: Array, points: Array) -> tuple[Array, Mask]:
    """Reprojection residuals (V, N, 2), 0 where a view does not show the point, and who shows it (V, N)."""
    seen: Mask = np.asarray(np.isfinite(pixels).all(axis=2))
    projected = np.stack([camera.project(points) for camera in cameras])
    residuals = np.where(seen[..., None], pixels - projected, 0.0)
    # A point behind a camera has no image there: its residual is NaN, and no comparison accepts it.
    return residuals, seen


def voxel_filtered(surface: SurfacePoints, voxel_m: float) -> SurfacePoints:
    """Points in a voxel replaced by their centre of gravity (paper, section 2.2).

    Neighbouring patches overlap, so that their errors are alike: the mean's covariance is taken as the mean
    covariance, not divided by the number of points. What is not a position is taken from the point nearest to it.
    """
    if len(surface) == 0:
        return surface
    members = voxel_members(surface.points, voxel_m)
    centres, covariances = _means(surface.points, members), _means(surface.covariances, members)
    kept = one_a_voxel(surface, voxel_m)
    return SurfacePoints(centres, covariances, kept.pixels, kept.residual_px, kept.colours, surface.s0)


def one_a_voxel(surface: SurfacePoints, voxel_m: float) -> SurfacePoints:
    """The measured point nearest to the centre of gravity of each voxel: a place of the surface, seen at its pixels."""
    if len(surface) == 0:
        return surface
    members = voxel_members(surface.points, voxel_m)
    distances = np.linalg.norm(surface.points - _means(surface.points, members)[members], axis=1)
    order = np.lexsort((distances, members))
    return surface.select(order[np.r_[0, np.cumsum(np.bincount(members))[:-1]]])


def _means(values: Array, members: Integers) -> Array:
    """Means (M, ...) of values (N, ...) over the members of each of M voxels."""
    columns = values.reshape(len(values), -1).T
    sums = np.stack([np.bincount(members, weights=column) for column in columns], axis=1)
    means: Array = (sums / np.bincount(members)[:, None]).reshape(-1, *values.shape[1:])
    return means


# Share of the common surface of two views that a measurement has reached, and why not more.

# Below half of the region, a surface is no success.
_ENOUGH = 0.5


@dataclass(frozen=True)
class Attempt:
    """Start of the measurement of one search image."""

    at: Array
    """(N, 2) template pixels that are known to be visible in both views."""

    n_seeds: int
    """Cells that growth started from."""

    faults: tuple[str, ...]
    """Why the others failed as seeds, a text for each."""


@dataclass(frozen=True)
class Coverage:
    """Result for the places known to be in both template and search image."""

    n_candidates: int
    """Approximate correspondences: image features that look alike and agree with the rig, or given seeds."""

    n_covered: int
    """Those of them with a measured point within reach."""

    n_seeds: int
    """Cells that growth started from."""

    faults: tuple[str, ...]
    """Why candidates failed as seeds, a text for each."""

    @property
    def share(self) -> float:
        """Of the candidates that are covered."""
        return self.n_covered / max(self.n_candidates, 1)

    def warning(self, template: str, search: str) -> str | None:
        """Warning about a surface that covers less than half of the views' common surface."""
        if self.share >= _ENOUGH:
            return None
        said = f"{template} - {search}: the surface covers {self.n_covered} of {self.n_candidates} places that both "
        said += f"views are known to show ({100 * self.share:.0f} %): it is not complete"
        if self.faults:
            reasons = ", ".join(f"{n} {why}" for why, n in Counter(self.faults).most_common(3))
            said += f"; {len(self.faults)} of {self.n_candidates} seeds failed: {reasons}"
        return said + "; try another matching.patch_px, views nearer to one another, or preparation.enhance_contrast"


def coverage_of(attempt: Attempt, at: Array, reach_px: float) -> Coverage:
    """What became of an attempt, where points were measured at template pixels (N, 2)."""
    n = len(attempt.at)
    gaps = cKDTree(at).query(attempt.at)[0] if len(at) and n else np.full(n, np.inf)
    return Coverage(n, int((np.asarray(gaps) <= reach_px).sum()), attempt.n_seeds, attempt.faults)
