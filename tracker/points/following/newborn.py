"""Points that begin to be followed: what is known of them at birth, and which of the others are their neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from tracker.foundation.arrays import Array, Integers, Mask
from tracker.points.following.keys import Keys
from tracker.points.following.points import Points
from tracker.points.trajectories import PointStatus

N_NEAREST, N_FARTHER = 12, 12
"""Neighbours of a point: the nearest ones, and some spread over its reach, which stay when all near ones hide."""

# Neighbours asked for at once: more than any template patch has.
_DENSEST = 300


@dataclass(frozen=True)
class NewPoints:
    """M points to be followed from now on."""

    pixels: Array
    """(V, M, 2) px, NaN where a view does not show them."""

    across: Array
    """(V, M, 2, 2) affine transformations of patches from the template's image to each view."""

    variances: Array
    """(V, M, 3) xx, yy, xy px^2 of each view's image beside the template's, which defines the point: 0 there."""

    positions: Array
    """(M, 3) metres; NaN in 2-D mode."""

    covariances: Array
    """(M, 3, 3) of the positions, m^2."""

    spacing_px: float = np.inf
    """How far apart they are, px."""

    def select(self, which: Mask | Integers) -> NewPoints:
        """The chosen ones."""
        views = (self.pixels[:, which], self.across[:, which], self.variances[:, which])
        return NewPoints(*views, self.positions[which], self.covariances[which], self.spacing_px)


def born(new: NewPoints, keys: tuple[Keys, ...], living: Points | None, reach_px: float, index: int) -> Points:
    """Points begin to be followed.

    Args:
        new: M points of this frame.
        keys: cut from its images.
        living: points that are followed already, in this frame; None for none.
        reach_px: neighbours lie no farther apart than this.
        index: number of the frame.
    """
    n, n_views = len(new.positions), len(new.pixels)
    first = 0 if living is None else living.next_id
    seen = np.isfinite(new.pixels).all(axis=2) & np.stack([key.usable for key in keys])
    pixels = np.where(seen[..., None], new.pixels, np.nan)
    ids = np.arange(first, first + n)
    neighbours, neighbour_pixels = _neighbours(pixels, new.positions, ids, living, reach_px)
    unit = np.tile(np.eye(2), (n_views, n, 1, 1))
    return Points(
        ids=ids,
        status=np.where(seen.any(axis=0), PointStatus.BORN, PointStatus.HIDDEN).astype(np.int64),
        pixels=pixels,
        before=np.full_like(pixels, np.nan),
        last_pixels=pixels.copy(),
        affine=unit,
        variances=np.zeros((n_views, n, 3)),
        drift=new.variances.copy(),
        positions=new.positions.copy(),
        birth_pixels=pixels.copy(),
        key_from_birth=unit.copy(),
        across=new.across.copy(),
        birth_drift=new.variances.copy(),
        neighbours=neighbours,
        neighbour_pixels=neighbour_pixels,
        since=np.zeros(n, dtype=np.int64),
        born=np.full(n, index),
        keys_in=np.full((n_views, n), index),
        bending=np.zeros((n_views, n, 2)),
        key_bending=np.zeros((n_views, n, 2)),
        keys=keys,
        birth_keys=tuple(key.select(np.arange(n)) for key in keys),
        next_id=first + n,
        latest=index,
    )


def _neighbours(
    pixels: Array, positions: Array, ids: Integers, living: Points | None, reach_px: float
) -> tuple[Integers, Array]:
    """Ids (M, K) of the points nearest in space, or in the image in 2-D mode, and their pixels (V, M, K, 2)."""
    n = len(positions)
    if living is not None:
        alive = living.alive
        pixels = np.concatenate([living.pixels[:, alive], pixels], axis=1)
        positions = np.concatenate([living.positions[alive], positions])
        ids = np.concatenate([living.ids[alive], ids])
    total = len(positions)
    flat = pixels.shape[0] == 1
    places = pixels[0] if flat else positions
    known = np.flatnonzero(np.isfinite(places).all(axis=1))
    chosen = np.full((n, N_NEAREST + N_FARTHER), -1)
    if len(known) > 1:
        tree, own = cKDTree(places[known]), np.arange(total - n, total)
        usable = np.flatnonzero(np.isfinite(places[own]).all(axis=1))
        for part in np.array_split(usable, len(usable) // 2000 + 1):
            _, near = tree.query(places[own[part]], k=min(_DENSEST, len(known)))
            near = known[np.asarray(near).reshape(len(part), -1)][:, 1:]
            gaps = np.linalg.norm(pixels[:, near] - pixels[:, own[part], None], axis=-1)
            close = np.where(np.isfinite(gaps), gaps, np.inf).min(axis=0) <= reach_px
            chosen[part] = _spread(np.where(close, near, -1))
    found = np.where(chosen[None, ..., None] >= 0, pixels[:, np.maximum(chosen, 0)], np.nan)
    return np.where(chosen >= 0, ids[np.maximum(chosen, 0)], -1), found


def _spread(near: Integers) -> Integers:
    """(M, N_NEAREST + N_FARTHER) of the neighbours (M, K), nearest first, -1 for those out of reach."""
    n_close = (near >= 0).sum(axis=1)
    wide = np.concatenate([near, np.full((len(near), N_NEAREST), -1)], axis=1)
    step = np.maximum((n_close - N_NEAREST) / N_FARTHER, 1.0)
    ranks = (N_NEAREST + np.arange(1, N_FARTHER + 1) * step[:, None]).astype(np.int64) - 1
    farther = np.where(ranks < n_close[:, None], np.take_along_axis(wide, np.minimum(ranks, wide.shape[1] - 1), 1), -1)
    return np.concatenate([wide[:, :N_NEAREST], farther], axis=1)
