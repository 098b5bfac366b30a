"""A following in numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.foundation.arrays import Integers
from tracker.points.following.cuts import Cuts
from tracker.points.following.record import AT_A_TIME, Rows, between
from tracker.points.trajectories import PointStatus


@dataclass(frozen=True)
class Summary:
    """A following in numbers."""

    n_frames: int
    n_points: int
    """Points that were born."""

    n_seen_first: int
    n_seen_last: int
    n_rekeyed: int
    """Times that a point got a new key."""

    n_found_again: int
    n_cut: int
    """Steps that the filters took for false."""

    n_removed: int
    median_sigma_mm: float | None
    """Point error in the last frame, root of the sum of the three variances; None in 2-D mode or without points."""

    median_sigma_px: float | None
    """The same of the image of one view, in 2-D mode."""

    points_a_second: float
    interrupted: bool

    warnings: tuple[str, ...]
    """What a user should know before the trajectories are used."""


@dataclass(frozen=True)
class Course:
    """How the following went."""

    seconds: float
    interrupted: bool
    warnings: tuple[str, ...]
    """Told on the way."""


def summarized(rows: Rows, frames: Integers, cuts: Cuts, course: Course) -> Summary:
    """Counts what was followed, and what the filters made of it.

    Args:
        rows: sightings in the order of the frames, before the filters.
        frames: (T,) all frame numbers.
        cuts: what the filters do.
        course: how the following went.
    """
    first, last = (between(rows, int(frame), int(frame) + 1) for frame in (frames[0], frames[-1]))
    flat = rows["pixels"].shape[1] == 1
    squares = last["sigmas_px"][:, 0] ** 2 if flat else np.diagonal(last["covariance"], axis1=1, axis2=2)
    usual = float(np.median(np.sqrt(squares.sum(axis=1)))) if len(last) else None
    n_with = np.zeros(len(PointStatus), dtype=np.int64)
    for k in range(0, len(rows), AT_A_TIME):
        n_with += np.bincount(rows["status"][k : k + AT_A_TIME], minlength=len(n_with))
    return Summary(
        n_frames=len(frames),
        n_points=cuts.n_before,
        n_seen_first=len(first),
        n_seen_last=len(last),
        n_rekeyed=int(n_with[PointStatus.REKEYED]),
        n_found_again=int(n_with[PointStatus.FOUND_AGAIN]),
        n_cut=cuts.n_fast + cuts.n_unlike,
        n_removed=cuts.n_removed,
        median_sigma_mm=None if flat or usual is None else 1000 * usual,
        median_sigma_px=usual if flat else None,
        points_a_second=round(len(rows) / max(course.seconds, 1e-9)),
        interrupted=course.interrupted,
        warnings=(*course.warnings, *_warnings(len(first), len(last), cuts)),
    )


# Below half of the points of the first frame.
_FEW = 0.5


def _warnings(first: int, last: int, cuts: Cuts) -> tuple[str, ...]:
    told = []
    if cuts.n_removed and cuts.n_removed == cuts.n_before:
        told.append(f"all {cuts.n_removed} trajectories are seen in too few frames, and removed: filters.min_frames")
    if last < _FEW * first:
        told.append(f"of {first} points at first, {last} are seen at last: most have been lost or are hidden")
    return tuple(told)
