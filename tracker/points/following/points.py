"""The followed points and all that is known of them: the state that a following carries from frame to frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tracker.foundation.arrays import Array, Integers, Mask
from tracker.points.following.keys import Keys, Starts
from tracker.points.trajectories import PointFrame, PointStatus


@dataclass
class Points:
    """N points. Mutable: it is the one thing that changes while points are followed.

    All arrays are about the latest frame unless they are called after birth.
    """

    ids: Integers
    """(N,)"""

    status: Integers
    """(N,) see `PointStatus`."""

    pixels: Array
    """(V, N, 2) px, NaN where not seen."""

    before: Array
    """(V, N, 2) px in the frame before, NaN where not seen."""

    last_pixels: Array
    """(V, N, 2) px where they were seen last."""

    affine: Array
    """(V, N, 2, 2) from the key's image; the latest known one."""

    variances: Array
    """(V, N, 3) xx, yy, xy px^2 of the match with the key."""

    drift: Array
    """(V, N, 3) xx, yy, xy px^2 that the key's place is uncertain by, in its own image."""

    positions: Array
    """(N, 3) metres; the latest known ones."""

    birth_pixels: Array
    """(V, N, 2) px; NaN where a view did not show the point."""

    key_from_birth: Array
    """(V, N, 2, 2) from the image of the birth to the key's."""

    across: Array
    """(V, N, 2, 2) from the template's image to each view, at birth."""

    birth_drift: Array
    """(V, N, 3) the drift of the keys cut at birth."""

    neighbours: Integers
    """(N, K) ids of points near at birth; -1 for none."""

    neighbour_pixels: Array
    """(V, N, K, 2) px that these had then."""

    since: Integers
    """(N,) frames since the point was seen last."""

    born: Integers
    """(N,) frame numbers of the births."""

    keys_in: Integers
    """(V, N) frame numbers of the images that the key patches were cut from."""

    bending: Array
    """(V, N, 2) px from the point to the mean of a patch of its birth, see `bending_shifts`; NaN where neighbours
    cannot tell."""

    key_bending: Array
    """(V, N, 2) px: the same in the key's image, in which the key lies around the point itself."""

    keys: tuple[Keys, ...]
    birth_keys: tuple[Keys, ...]
    next_id: int

    latest: int
    """Number of the frame; those without enough images are passed over."""

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def n_views(self) -> int:
        """Number of views."""
        return len(self.pixels)

    @property
    def alive(self) -> Mask:
        """(N,) points that were seen in the latest frame."""
        alive: Mask = self.status != PointStatus.HIDDEN
        return alive

    @property
    def needed(self) -> Integers:
        """(N,) views that showed each point at birth; one for those that none has a patch of."""
        count: Integers = np.maximum(np.isfinite(self.birth_pixels[..., 0]).sum(axis=0), 1)
        return count

    @property
    def total_variances(self) -> Array:
        """(V, N, 3) px^2 of the pixels against the material point of the birth: match and drift."""
        return carried(self.drift, self.affine) + self.variances

    def rows_of(self, ids: Integers) -> Integers:
        """Rows of ids of any shape; -1 for unknown ones."""
        if not len(self.ids):
            return np.full(ids.shape, -1)
        place = np.minimum(np.searchsorted(self.ids, ids), len(self.ids) - 1)
        rows: Integers = np.where(self.ids[place] == ids, place, -1)
        return rows

    def frame(self, index: int, time_s: float, covariances: Array) -> PointFrame:
        """What is known in this frame, as a value of its own."""
        drift = np.sqrt(np.nan_to_num(carried(self.drift, self.affine)[..., :2]).max(axis=(0, 2), initial=0.0))
        alive = self.alive
        positions = np.where(alive[:, None], self.positions, np.nan)
        covariances = np.where(alive[:, None, None], covariances, np.nan)
        sigmas = np.where(np.isfinite(self.pixels), np.sqrt(self.total_variances[..., :2]), np.nan)
        known = self.ids.copy(), self.pixels.copy(), sigmas
        origin = self.status.copy(), self.born.copy(), self.keys_in.copy()
        return PointFrame(index, time_s, *known, positions, covariances, drift, *origin)

    def unseen(self, index: int, time_s: float) -> PointFrame:
        """A frame that shows none of them."""
        n, hidden = len(self), np.full(len(self), int(PointStatus.HIDDEN))
        pixels, places = np.full((self.n_views, n, 2), np.nan), np.full((n, 3), np.nan)
        nothing = pixels, pixels.copy(), places, np.full((n, 3, 3), np.nan), np.full(n, np.nan)
        origin = hidden, self.born.copy(), self.keys_in.copy()
        return PointFrame(index, time_s, self.ids.copy(), *nothing, *origin)

    def select(self, kept: Mask) -> Points:
        """The chosen ones alone."""
        chosen = {name: getattr(self, name)[kept] for name in _FIRST_AXIS}
        chosen |= {name: getattr(self, name)[:, kept] for name in _SECOND_AXIS}
        keys = tuple(k.select(kept) for k in self.keys), tuple(k.select(kept) for k in self.birth_keys)
        return Points(**chosen, keys=keys[0], birth_keys=keys[1], next_id=self.next_id, latest=self.latest)

    def joined(self, more: Points) -> Points:
        """Both, the newer ones last."""
        chosen = {name: np.concatenate([getattr(self, name), getattr(more, name)]) for name in _FIRST_AXIS}
        chosen |= {name: np.concatenate([getattr(self, name), getattr(more, name)], axis=1) for name in _SECOND_AXIS}
        keys = tuple(a.joined(b) for a, b in zip(self.keys, more.keys, strict=True))
        births = tuple(a.joined(b) for a, b in zip(self.birth_keys, more.birth_keys, strict=True))
        return Points(**chosen, keys=keys, birth_keys=births, next_id=more.next_id, latest=self.latest)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All of it under flat names, to be saved; see `restored`."""
        saved: dict[str, NDArray[Any]] = {name: getattr(self, name) for name in (*_FIRST_AXIS, *_SECOND_AXIS)}
        for kind, all_keys in (("keys", self.keys), ("birth_keys", self.birth_keys)):
            for v, keys in enumerate(all_keys):
                saved |= {f"{kind}_{v}_{field.name}": getattr(keys, field.name) for field in fields(Keys)}
        return saved | {"next_id": np.array(self.next_id), "latest": np.array(self.latest)}


_FIRST_AXIS = ("ids", "status", "positions", "neighbours", "since", "born")
_SECOND_AXIS = (
    *("pixels", "before", "last_pixels", "affine", "variances", "drift", "birth_pixels", "key_from_birth"),
    *("across", "birth_drift", "neighbour_pixels", "keys_in", "bending", "key_bending"),
)


def restored(saved: Mapping[str, NDArray[Any]]) -> Points:
    """Points from their `arrays`."""
    chosen: dict[str, Any] = {name: saved[name] for name in (*_FIRST_AXIS, *_SECOND_AXIS)}

    def keys(kind: str) -> tuple[Keys, ...]:
        n_views = len(saved["pixels"])
        return tuple(Keys(*(saved[f"{kind}_{v}_{field.name}"] for field in fields(Keys))) for v in range(n_views))

    chosen |= {"next_id": int(saved["next_id"]), "latest": int(saved["latest"])}
    return Points(**chosen, keys=keys("keys"), birth_keys=keys("birth_keys"))


def carried(variances: Array, affine: Array) -> Array:
    """Covariances xx, yy, xy (..., 3) under affine transformations (..., 2, 2)."""
    xx, yy, xy = np.moveaxis(variances, -1, 0)
    a, b, c, d = affine[..., 0, 0], affine[..., 0, 1], affine[..., 1, 0], affine[..., 1, 1]
    return np.stack(
        [
            a * a * xx + 2 * a * b * xy + b * b * yy,
            c * c * xx + 2 * c * d * xy + d * d * yy,
            a * c * xx + (a * d + b * c) * xy + b * d * yy,
        ],
        axis=-1,
    )


# Points that begin to be followed: what is known of them at birth, and which of the others are their neighbours.

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


# Where neighbours expect a point: a local affine map of the image since the point's birth.

LEAST = 6
"""An affinity has six unknowns in two coordinates: three points; twice as many, so that a wrong one shows."""

# Regularizes an affinity over neighbours that lie within some pixels; neighbours at 8 px count half.
_STIFFNESS_PX2, _NEAR_PX = 1.0, 8.0


def expected(points: Points, pixels: Array, which: Integers, view: int) -> Starts:
    """Where living neighbours expect M points, and how patches of the points' births look there.

    Least squares of ``c + F o`` for the neighbours' offsets o at the point's birth, with F held towards the unit matrix
    by one pixel squared, so that neighbours in a line do not turn the map over; near neighbours count more.

    Args:
        points: all N points.
        pixels: (V, N, 2) where they are now, px; NaN where not seen.
        which: (M,) rows of the points asked for.
        view: index of the view.

    Returns:
        Places and affine transformations from the birth; NaN where fewer than six neighbours are seen.
    """
    rows = points.rows_of(points.neighbours[which])
    at_birth = points.neighbour_pixels[view, which] - points.birth_pixels[view, which][:, None]
    now = pixels[view][np.maximum(rows, 0)]
    usable = (rows >= 0) & np.isfinite(now).all(axis=2) & np.isfinite(at_birth).all(axis=2)
    o = np.where(usable[..., None], at_birth, 0.0)
    weight = usable / (1.0 + (o**2).sum(axis=2) / _NEAR_PX**2)
    design = np.concatenate([o, np.ones((*o.shape[:2], 1))], axis=2)
    moved = np.where(usable[..., None], now, 0.0) - o
    normal = np.einsum("nki,nkj,nk->nij", design, design, weight)
    normal += np.diag([_STIFFNESS_PX2, _STIFFNESS_PX2, 1e-6])
    right = np.einsum("nki,nkj,nk->nij", design, moved, weight)
    solution = np.linalg.solve(normal, right)
    enough = usable.sum(axis=1) >= LEAST
    pixels = np.where(enough[:, None], solution[:, 2], np.nan)
    return Starts(pixels, np.swapaxes(solution[:, :2], 1, 2) + np.eye(2))
