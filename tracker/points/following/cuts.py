"""Trajectories cut at false steps: what follows is another place of the surface, and gets an id of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.foundation.arrays import Array, Integers
from tracker.points.following.filters import FAR_FRAMES, TrajectoryFilters
from tracker.points.following.record import AT_A_TIME, Rows
from tracker.points.following.windows import MOST_SIGHTINGS, windows

# Ids and frame numbers as one number, in the order of ids.
_FRAMES = 1 << 32


@dataclass(frozen=True)
class Cuts:
    """What the filters make of the trajectories of a record."""

    n_fast: int
    """Steps cut for their velocity or acceleration."""

    n_unlike: int
    """Steps cut because neighbours move otherwise."""

    n_removed: int
    """Trajectories of which nothing long enough is left."""

    false: Integers
    """(F,) false steps, in order: id and frame."""

    steps: Array
    """(F, 2, D) from where to where they went, in any order."""

    pieces: Integers
    """(P,) pieces of trajectories, in order: id and how many false steps were before."""

    ids: Integers
    """(P,) new ids of the pieces; -1 for those that are too short."""

    n_seen: Integers
    """(P,) sightings of each piece."""

    def relabelled(self, rows: Rows) -> Rows:
        """Sightings with the ids of their pieces, without those of pieces that are too short."""
        ids = self.ids[np.searchsorted(self.pieces, _pieces_of(rows, self.false))]
        changed = rows[ids >= 0].copy()
        changed["id"] = ids[ids >= 0]
        return changed

    def longest(self, first: Integers, most: int) -> Integers:
        """Ids of some of the trajectories that are left: the first ones, then those seen in most frames; in order."""
        kept = self.ids >= 0
        ids, n_seen = self.ids[kept], self.n_seen[kept]
        order = np.lexsort((ids, -n_seen, ~np.isin(ids, first)))
        return np.sort(ids[order[:most]])

    @property
    def n_before(self) -> int:
        """Trajectories before they were cut."""
        return len(np.unique(self.pieces // _FRAMES))

    @property
    def parents(self) -> dict[int, int]:
        """Ids of the trajectories that those with new ids were parts of."""
        kept = self.ids >= 0
        return dict(zip(self.ids[kept].tolist(), (self.pieces[kept] // _FRAMES).tolist(), strict=True))


def no_cuts(rows: Rows) -> Cuts:
    """Trajectories as they are."""
    none = np.zeros(0, dtype=np.int64)
    pieces, n_seen = _counted(rows, none)
    return Cuts(0, 0, 0, none, np.zeros((0, 2, 2)), pieces, pieces // _FRAMES, n_seen)


def cut_where_false(
    filters: TrajectoryFilters, rows: Rows, frames: Integers, times: Array, most_sightings: int = MOST_SIGHTINGS
) -> Cuts:
    """Looks for false steps and for the pieces between them.

    Args:
        filters: what is false, and how long pieces must be.
        rows: sightings in space, in the order of the frames.
        frames: (T,) all frame numbers.
        times: (T,) seconds.
        most_sightings: held at a time, about.
    """
    false, steps, n_fast, n_unlike = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 2, 3))], 0, 0
    for window in windows(rows, frames, times, FAR_FRAMES, most_sightings=most_sightings):
        found, own = filters.false_steps(window.trajectories), window.trajectories
        fast, unlike = found.fast[window.inner], found.unlike[window.inner]
        t, n = np.nonzero(fast | unlike)
        t += window.inner.start
        false.append(own.ids[n] * _FRAMES + own.frames[t])
        steps.append(np.stack([own.positions[t - 1, n], own.positions[t, n]], axis=1))
        n_fast, n_unlike = n_fast + int(fast.sum()), n_unlike + int(unlike.sum())
    ordered = np.sort(np.concatenate(false))
    pieces, n_seen = _counted(rows, ordered)
    ids, n_removed = _new_ids(pieces, n_seen, filters.min_frames)
    return Cuts(n_fast, n_unlike, n_removed, ordered, np.concatenate(steps), pieces, ids, n_seen)


def _pieces_of(rows: Rows, false: Integers) -> Integers:
    """(M,) id of each sighting, and how many false steps it had before."""
    ids = rows["id"].astype(np.int64)
    before = np.searchsorted(false, ids * _FRAMES + rows["frame"], side="right")
    pieces: Integers = ids * _FRAMES + before - np.searchsorted(false, ids * _FRAMES)
    return pieces


def _counted(rows: Rows, false: Integers) -> tuple[Integers, Integers]:
    """All pieces in order, and their numbers of sightings."""
    pieces, counts = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    for k in range(0, len(rows), AT_A_TIME):
        own, n_own = np.unique(_pieces_of(np.asarray(rows[k : k + AT_A_TIME]), false), return_counts=True)
        pieces, place = np.unique(np.concatenate([pieces, own]), return_inverse=True)
        counts = np.bincount(place.ravel(), np.concatenate([counts, n_own]), len(pieces)).astype(np.int64)
    return pieces, counts


def _new_ids(pieces: Integers, n_seen: Integers, min_frames: int) -> tuple[Integers, int]:
    """Ids of the pieces, and how many trajectories have none.

    The first piece is the point that was born, and keeps its id; a later one is another place of the surface.
    """
    parents, number = pieces // _FRAMES, pieces % _FRAMES
    long = n_seen >= min_frames
    fresh = long & (number > 0)
    ids = np.where(long, parents, -1)
    ids[fresh] = int(parents.max(initial=-1)) + 1 + np.arange(int(fresh.sum()))
    return ids, len(np.unique(parents)) - len(np.unique(parents[long]))
