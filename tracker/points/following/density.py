"""How densely points lie: new ones on surface that has come into sight, one of two that have run together."""

from __future__ import annotations

import numpy as np
import pydantic
from scipy.spatial import cKDTree

from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.configuration.components import component
from tracker.points.following.neighbours import expected
from tracker.points.following.newborn import NewPoints
from tracker.points.following.points import Points


@component
class Density:
    """The paper's density check (section 2.3.2, figure 9), made every few frames."""

    every_frames: int = pydantic.Field(default=10, ge=1)
    """Frames between two checks; each measures the surface anew, which takes as long as following for some frames."""

    gap: float = pydantic.Field(default=1.5, gt=0)
    """New points are born where none is nearer than this many times the spacing of the measured surface."""

    merge: float = pydantic.Field(default=0.3, ge=0, lt=1)
    """Of two points nearer than this many times the spacing in every view, the younger one ends; 0 keeps all."""

    forget_frames: int | None = pydantic.Field(default=250, ge=1)
    """Points hidden for so many frames are looked for no more; None looks for them for ever."""

    def new_places(self, points: Points, new: NewPoints) -> Mask:
        """(M,) new points where no point is, nor where neighbours expect a hidden one."""
        hidden = np.flatnonzero(~points.alive)
        free = np.ones(len(new.positions), dtype=np.bool_)
        for v in range(points.n_views):
            places = np.concatenate([points.pixels[v][points.alive], expected(points, points.pixels, hidden, v).pixels])
            places = places[np.isfinite(places).all(axis=1)]
            seen = np.flatnonzero(np.isfinite(new.pixels[v]).all(axis=1))
            if len(places) and len(seen):
                gaps, _ = cKDTree(places).query(new.pixels[v][seen])
                free[seen] &= np.asarray(gaps) > self.gap * new.spacing_px
        return free

    def kept(self, points: Points, spacing_px: float) -> Mask:
        """(N,) points that go on: neither merged with an older one nor forgotten."""
        kept = np.ones(len(points), dtype=np.bool_)
        if self.forget_frames is not None:
            kept &= points.since <= self.forget_frames
        if self.merge > 0 and np.isfinite(spacing_px):
            kept[_younger(points.pixels, self.merge * spacing_px)] = False
        return kept


def _younger(pixels: Array, reach_px: float) -> Integers:
    """Rows of the younger of two points that lie together in all views that show both."""
    together: set[tuple[int, int]] = set()
    for view in pixels:
        seen = np.flatnonzero(np.isfinite(view).all(axis=1))
        if len(seen) > 1:
            together |= {(int(seen[a]), int(seen[b])) for a, b in cKDTree(view[seen]).query_pairs(reach_px)}
    return np.unique([max(pair) for pair in together if _always_near(pixels, pair, reach_px)]).astype(np.int64)


def _always_near(pixels: Array, pair: tuple[int, int], reach_px: float) -> bool:
    gaps = np.linalg.norm(pixels[:, pair[0]] - pixels[:, pair[1]], axis=1)
    return bool((gaps[np.isfinite(gaps)] <= reach_px).all())
