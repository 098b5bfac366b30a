"""What moves with a segment of a body over several frames, and no part of the body explains: cells of space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from tracker.acquisition.beside import CELL_M, Surroundings, shown_in
from tracker.arrays import Array, Mask
from tracker.body import BodyModel

_REACH_M = 0.9
"""How far things reach from the landmarks of the segment that carries them, metres."""

_NEARLY = 0.8
"""Of the most cells that move with a segment."""

_MOST_EMPTY, _LEAST_APART = 0.25, 0.4
"""Share of the frames in which a cell may be background somewhere, and in which two views must show it beside the
persons, at least."""

_LEAST_CELLS = 4
"""That are so, 0.11 l. Of 46 recordings of persons who carry nothing none has one, those by two cameras included; of 12
with a rucksack, a racket or a ball the least was 5."""

_WHOLE_EMPTY, _WHOLE_BESIDE, _FURTHER_M = 0.35, 0.3, 0.3
"""The same shares for what belongs to a thing that has such cells, where one view need show it beside the persons, and
how far it reaches beyond them: of a rucksack what lies against the back."""


@dataclass(frozen=True)
class Moving:
    """Cells that move with what hangs on a parameter of a body."""

    end: int
    """The parameter."""

    points: Array
    """(N, 3) where the cells are in the reference pose, metres."""

    shares: Array
    """(N,) of the frames in which two views show each beside the persons."""

    @property
    def n_shown(self) -> float:
        """Cells that a frame shows on average."""
        return float(self.shares.sum())

    def gap_m(self, marks: Array) -> float:
        """From the middle of the cells to the nearest of points (N, 3), metres."""
        return float(np.linalg.norm(self.points.mean(axis=0) - marks, axis=1).min())


def most_moving(frames: Sequence[Surroundings], body: BodyModel) -> Moving | None:
    """The cells that move with one of the segments, of several the one with most; None where none do.

    Who does not turn the head wears a rucksack on the neck as well: of segments with nearly as many cells it is the one
    nearest to them.

    Args:
        frames: what is around one person, whose poses differ.
        body: the person's.
    """
    if not frames or sum(one.tells for one in frames) < _LEAST_APART * len(frames):
        return None
    ends = np.array([mark.parameter for mark in body.landmarks])
    marks = np.array([mark.point for mark in body.landmarks])
    found = [_moving(frames, int(end), marks[ends == end]) for end in np.unique(ends[ends >= 0])]
    found = [one for one in found if len(one.points) >= _LEAST_CELLS]
    if not found:
        return None
    most = max(one.n_shown for one in found)
    likely = [one for one in found if one.n_shown >= _NEARLY * most]
    return _whole(frames, min(likely, key=lambda one: one.gap_m(marks[ends == one.end])))


def _moving(frames: Sequence[Surroundings], end: int, marks: Array) -> Moving:
    """The cells that move with what hangs on a parameter, near its landmarks (N, 3) in the reference pose."""
    points = _candidates(frames, end, marks)
    empty, _, apart = _shares(frames, end, points)
    sure = (empty <= _MOST_EMPTY) & (apart >= _LEAST_APART)
    return Moving(end, points[sure], apart[sure])


def _whole(frames: Sequence[Surroundings], core: Moving) -> Moving:
    """A thing with what of it is seldom beside the persons in two views: cells that hang together with the core."""
    low, high = core.points.min(axis=0) - _FURTHER_M, core.points.max(axis=0) + _FURTHER_M
    numbers = [np.arange(round(a / CELL_M), round(b / CELL_M) + 1) for a, b in zip(low, high, strict=True)]
    lattice = np.stack(np.meshgrid(*numbers, indexing="ij"), axis=-1)
    points = lattice.reshape(-1, 3) * CELL_M
    empty, beside, apart = _shares(frames, core.end, points)
    sure = (empty <= _MOST_EMPTY) & (apart >= _LEAST_APART)
    filled = sure | ((empty <= _WHOLE_EMPTY) & (beside >= _WHOLE_BESIDE))
    labels = ndimage.label(filled.reshape(lattice.shape[:3]), structure=np.ones((3, 3, 3)))[0].ravel()
    kept = np.isin(labels, np.unique(labels[sure]))
    return Moving(core.end, points[kept], apart[kept])


def _shares(frames: Sequence[Surroundings], end: int, points: Array) -> tuple[Array, Array, Array]:
    """Of the frames in which each of points (N, 3) is empty, is beside the persons in a view, and in two."""
    n = np.zeros((3, len(points)))
    for one in frames:
        motion = one.world_from_reference[end]
        empty, n_apart = shown_in(one.views, points @ motion[:3, :3].T + motion[:3, 3])
        n += empty, ~empty & (n_apart >= 1), ~empty & (n_apart >= 2)
    empty_in, beside_in, apart_in = n / max(len(frames), 1)
    return empty_in, beside_in, apart_in


def _candidates(frames: Sequence[Surroundings], end: int, marks: Array) -> Array:
    """Middles (N, 3) in the reference pose of the cells that are beside the persons in any of the frames."""
    found = [np.zeros((0, 3))]
    for one in frames:
        motion = one.world_from_reference[end]
        found.append((one.beside - motion[:3, 3]) @ motion[:3, :3])
    points = np.unique(np.round(np.concatenate(found) / CELL_M), axis=0) * CELL_M
    near: Mask = np.linalg.norm(points[:, None] - marks, axis=-1).min(axis=1, initial=np.inf) <= _REACH_M
    return points[near]
