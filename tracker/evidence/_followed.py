"""Tables of followed points beside the views: those of a view's image, or one in space."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from tracker.foundation.arrays import Array, Integers
from tracker.foundation.errors import SequenceError
from tracker.foundation.files import Stamp, stamp_of
from tracker.points.following.tables import TABLE, PointTable, read_trajectories


@dataclass(frozen=True)
class Followed:
    """One table."""

    view: int
    """Number of the view whose image the points lie in; -1 in space."""

    trajectories: PointTable

    def at(self, frame: int) -> tuple[Integers, Array, Array]:
        """Numbers (N,) of the points that a frame shows, their places (N, D) and covariances (N, D, D), m or px."""
        t = frame - int(self.trajectories.frames[0])
        if not 0 <= t < len(self.trajectories.frames):
            n_axes = self.trajectories.positions.shape[2]
            return np.zeros(0, dtype=np.int64), np.zeros((0, n_axes)), np.zeros((0, n_axes, n_axes))
        seen = np.flatnonzero(self.trajectories.seen[t])
        return seen, self.trajectories.positions[t, seen], self.trajectories.covariances[t, seen]


def open_followed(pattern: str, views: tuple[str, ...], downscales: tuple[float, ...]) -> tuple[Followed, ...]:
    """The tables that a path means, read once as long as they stay as they are.

    Args:
        pattern: a table or a result folder of `bodytrack follow`; with `{view}` one for each view that has one.
        views: names of the cameras.
        downscales: one a view, how much larger the images were that points were followed in.

    Raises:
        SequenceError: there is none, or points of an image without a view.
    """
    paths = [Path(pattern.replace("{view}", name)) for name in views]
    return _opened(pattern, views, downscales, tuple(map(stamp_of, paths)))


@lru_cache(maxsize=8)
def _opened(
    pattern: str, views: tuple[str, ...], downscales: tuple[float, ...], _: tuple[Stamp, ...]
) -> tuple[Followed, ...]:
    if "{view}" not in pattern:
        found = read_trajectories(Path(pattern))
        if found.flat and len(views) > 1:
            raise SequenceError(
                f"{pattern}: points in the image of one view, and the recording has {len(views)}: follow each by "
                "itself, and put {view} for its name into the path"
            )
        return (_scaled(0 if found.flat else -1, found, downscales[0]),)
    paths = [Path(pattern.replace("{view}", name)) for name in views]
    present = [k for k, path in enumerate(paths) if path.exists()]
    if not present:
        raise SequenceError(f"{pattern}: no followed points of any view ({', '.join(views)}); expected {TABLE}")
    tables = []
    for k in present:
        found = read_trajectories(paths[k])
        if not found.flat:
            raise SequenceError(f"{paths[k]}: points in space, expected those of view {views[k]} in its image")
        tables.append(_scaled(k, found, downscales[k]))
    return tuple(tables)


def _scaled(view: int, found: PointTable, downscale: float) -> Followed:
    """Pixels as they are in the images that are tracked; pixel centres lie at integer coordinates."""
    if not found.flat or downscale == 1:
        return Followed(view, found)
    places = (found.positions + 0.5) / downscale - 0.5
    return Followed(view, replace(found, positions=places, covariances=found.covariances / downscale**2))
