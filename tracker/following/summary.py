"""A following in numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.arrays import Mask
from tracker.following.filters import Filtered
from tracker.point_trajectories import PointStatus, PointTrajectories


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


def summarized(whole: PointTrajectories, filtered: Filtered | None, course: Course) -> Summary:
    """Counts what was followed, and what the filters made of it."""
    seen = whole.seen
    sigma = np.sqrt((whole.sigmas[-1] ** 2).sum(axis=1))
    usual = float(np.median(sigma[seen[-1]])) if seen[-1].any() else None
    return Summary(
        n_frames=len(whole.frames),
        n_points=len(whole.ids),
        n_seen_first=int(seen[0].sum()),
        n_seen_last=int(seen[-1].sum()),
        n_rekeyed=int((whole.status == PointStatus.REKEYED).sum()),
        n_found_again=int((whole.status == PointStatus.FOUND_AGAIN).sum()),
        n_cut=0 if filtered is None else filtered.n_fast + filtered.n_unlike,
        n_removed=0 if filtered is None else filtered.n_removed,
        median_sigma_mm=None if whole.flat or usual is None else 1000 * usual,
        median_sigma_px=usual if whole.flat else None,
        points_a_second=round(float(seen.sum() / max(course.seconds, 1e-9))),
        interrupted=course.interrupted,
        warnings=(*course.warnings, *_warnings(seen)),
    )


# Below half of the points of the first frame.
_FEW = 0.5


def _warnings(seen: Mask) -> tuple[str, ...]:
    first, last = int(seen[0].sum()), int(seen[-1].sum())
    if last >= _FEW * first:
        return ()
    return (f"of {first} points at first, {last} are seen at last: most have been lost or are hidden",)
