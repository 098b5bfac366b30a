"""Validity of trajectories: the paper's filters (section 2.3.2, figure 12), and cuts at false steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pydantic

from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.configuration.components import component
from tracker.points.following.record import AT_A_TIME, MOST_SIGHTINGS, Rows, windows
from tracker.points.trajectories import PointTrajectories

# The median of fewer than four neighbours is moved by one wrong one.
_LEAST_IN_VOXEL = 4
# Usual deviations among the neighbours: a choice.
_SPREADS = 4.0


@dataclass(frozen=True)
class FalseSteps:
    """Steps that no body makes."""

    fast: Mask
    """(T, N) steps into each frame whose velocity or acceleration is too large."""

    unlike: Mask
    """(T, N) steps where neighbours move otherwise."""


FAR_FRAMES = 6
"""Frames farther from a step have no say in whether it is false."""


@component
class TrajectoryFilters:
    """Cuts trajectories where they move as no body does, or otherwise than their neighbours.

    A trajectory that is cut is no longer that of one material point: what follows gets an id of its own, and pieces
    that are too short are removed.
    """

    max_speed_m_s: float = pydantic.Field(default=15.0, gt=0)
    """Faster steps are false, m/s; hands of athletes reach 10."""

    max_acceleration_m_s2: float = pydantic.Field(default=500.0, gt=0)
    """Steps whose velocity differs more from the median of those around, a frame's time, are false, m/s^2."""

    voxel_mm: float = pydantic.Field(default=50.0, gt=0)
    """Side of the cubes in which points should move alike, mm."""

    max_difference_m_s: float = pydantic.Field(default=0.2, gt=0)
    """Steps whose velocity differs more from the median of the cube in three frames are false, m/s; added to four times
    the spread of the cube, which turns and stretches."""

    min_frames: int = pydantic.Field(default=3, ge=1)
    """Trajectories that are seen in fewer frames are removed."""

    def false_steps(self, trajectories: PointTrajectories) -> FalseSteps:
        """Judges the steps of trajectories in space (T, N, 3)."""
        steps, elapsed = _steps(trajectories)
        fast = self._fast(steps, elapsed)
        steps = np.where(fast[..., None], np.nan, steps)
        # A turning surface has other velocities at each place, but hardly others than a moment ago: changes tell small
        # jumps, the velocities themselves tell those that move otherwise all the time.
        unlike = self._unlike(trajectories, steps) | self._unlike(trajectories, steps - _usual(steps))
        return FalseSteps(fast, unlike)

    def _fast(self, steps: Array, elapsed: Array) -> Mask:
        """(T, N) steps into each frame that are too fast, or too much faster than those around."""
        with np.errstate(invalid="ignore"):
            jerk = np.linalg.norm(steps - _usual(steps), axis=2) / elapsed[:, None]
            speed = np.linalg.norm(steps, axis=2)
            fast: Mask = (speed > self.max_speed_m_s) | (jerk > self.max_acceleration_m_s2)
        return fast

    def _unlike(self, trajectories: PointTrajectories, steps: Array) -> Mask:
        """(T, N) steps unlike the median of the cube in the frames before, of and after each."""
        unlike = np.zeros(steps.shape[:2], dtype=np.bool_)
        for t in range(len(steps)):
            frames = np.arange(max(1, t - 1), min(len(steps), t + 2))
            own = np.isfinite(steps[t, :, 0])
            if not own.any():
                continue
            points = np.flatnonzero(own)
            # where each step started: a jump may have led out of all cubes
            places = trajectories.positions[t - 1, points] / (self.voxel_mm / 1000)
            # cubes, and others half a cube beside: a point at the edge of one is in the midst of the other
            for shift in (0.0, 0.5):
                _, members = np.unique(np.floor(places + shift).astype(np.int64), axis=0, return_inverse=True)
                unlike[t, points] |= self._apart(steps[frames][:, points], steps[t, points], members.ravel())
        return unlike

    def _apart(self, around: Array, own: Array, members: Integers) -> Mask:
        """(M,) points whose step (M, 3) is unlike those of the same cube in the frames around (F, M, 3)."""
        n_cubes = int(members.max()) + 1
        median = np.stack([_medians(around[..., k], members, n_cubes) for k in range(3)], axis=1)
        gaps = np.linalg.norm(around - median[members], axis=2)
        spread = _medians(gaps, members, n_cubes)
        crowd = np.bincount(members, minlength=n_cubes)[members]
        limit = self.max_difference_m_s + _SPREADS * spread[members]
        apart: Mask = (crowd >= _LEAST_IN_VOXEL) & (np.linalg.norm(own - median[members], axis=1) > limit)
        return apart


def _steps(trajectories: PointTrajectories) -> tuple[Array, Array]:
    """Velocities (T, N, D) of the steps into each frame, NaN where the frame before does not show the point; times."""
    elapsed = np.diff(trajectories.times, prepend=trajectories.times[0] - 1.0)
    steps = np.diff(trajectories.positions, axis=0, prepend=np.full_like(trajectories.positions[:1], np.nan))
    return steps / elapsed[:, None, None], elapsed


def _usual(steps: Array) -> Array:
    """Median (T, N, D) over five frames, each axis by itself."""
    padded = np.pad(steps, ((2, 2), (0, 0), (0, 0)), constant_values=np.nan)
    return _nanmedian(np.stack([padded[k : k + len(steps)] for k in range(5)]))


def _nanmedian(stack: Array) -> Array:
    """Median over the first axis of what is finite; NaN where nothing is."""
    ordered = np.sort(stack, axis=0)
    count = np.isfinite(ordered).sum(axis=0)
    low, high = np.maximum(count - 1, 0) // 2, np.maximum(count, 1) // 2
    high = np.minimum(high, np.maximum(count - 1, 0))
    middle = [np.take_along_axis(ordered, rank[None], axis=0)[0] for rank in (low, high)]
    return np.asarray(0.5 * (middle[0] + middle[1]))


def _medians(values: Array, members: Integers, n_groups: int) -> Array:
    """(n_groups,) medians of the finite values (F, M) of each group; 0 for groups without any."""
    groups = np.broadcast_to(members, values.shape).ravel()
    flat = values.ravel()
    known = np.isfinite(flat)
    order = np.lexsort((flat[known], groups[known]))
    flat, groups = flat[known][order], groups[known][order]
    count = np.bincount(groups, minlength=n_groups)
    first = np.cumsum(count) - count
    medians = np.zeros(n_groups)
    some = count > 0
    low, high = first + np.maximum(count - 1, 0) // 2, first + count // 2
    medians[some] = 0.5 * (flat[low[some]] + flat[high[some]])
    return medians


# Trajectories cut at false steps: what follows is another place of the surface, and gets an id of its own.

# Ids and frame numbers as one number, in the order of ids.
_FRAMES = 1 << 32


@dataclass(frozen=True)
class Cuts:
    """Result of the filters for the trajectories of a record."""

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
