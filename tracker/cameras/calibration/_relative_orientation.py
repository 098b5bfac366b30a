"""Two views oriented to each other by the bar positions that both show."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from tracker.foundation.arrays import Array, Mask
from tracker.foundation.errors import CalibrationError

_EPIPOLAR_PX = 4.0
"""Errors that are taken for distortion and a wrong focal length."""

# Ten bars are 20 points, four times the five that an essential matrix needs; of many, 100 spread evenly do.
FEWEST_BARS, _SAMPLED_BARS = 10, 100


@dataclass(frozen=True)
class Pair:
    """Two views oriented to each other."""

    views: tuple[int, int]
    flipped: bool
    rotation: Array
    translation: Array
    n_fitting: int
    n_shared: int
    spread: float
    """Median deviation of the bar's length from its median, as a share of it."""

    @property
    def score(self) -> float:
        """Higher is better."""
        return self.n_fitting / (0.02 + self.spread)

    @property
    def good(self) -> bool:
        """Whether no other pair need be looked at."""
        return self.n_fitting > 0.6 * self.n_shared and self.spread < 0.05


def best_pair(plane: Array, nominal: Array, names: Sequence[str]) -> Pair:
    """The two views with most bars that agree with one relative orientation and one bar length.

    Raises:
        CalibrationError: there are not two views, they share too few bars, or none fit together.
    """
    if len(names) < 2:
        raise CalibrationError(
            f"the bar is seen by {', '.join(names) or 'no view'} alone, expected at least two views: record it with "
            "all cameras at once"
        )
    seen: Mask = np.asarray(np.isfinite(plane).all(axis=(2, 3)))
    shared = {(i, j): int((seen[i] & seen[j]).sum()) for i, j in itertools.combinations(range(len(seen)), 2)}
    chosen = sorted(shared, key=lambda pair: -shared[pair])[:12]
    if shared[chosen[0]] < FEWEST_BARS:
        i, j = chosen[0]
        raise CalibrationError(
            f"no two views show {FEWEST_BARS} common bar positions ({names[i]} and {names[j]} share {shared[i, j]}, "
            "the most): move the bar where two cameras see both its ends"
        )
    best: Pair | None = None
    for pair, flip in itertools.product(chosen, (False, True)):
        found = _relative(plane, nominal, pair, flip) if shared[pair] >= FEWEST_BARS else None
        if found is not None and (best is None or found.score > best.score):
            best = found
        if best is not None and best.good:
            break
    if best is None:
        raise CalibrationError(
            "no two views fit together: are they synchronized, are the focal lengths right to 10 %, and is the bar "
            "moved in all directions?"
        )
    return best


def _relative(plane: Array, nominal: Array, views: tuple[int, int], flip: bool) -> Pair | None:
    """Relative orientation by RANSAC over the five-point solution (Nister 2004)."""
    i, j = views
    first, second = plane[i], plane[j][:, ::-1] if flip else plane[j]
    both = np.asarray(np.isfinite(first).all(axis=(1, 2)) & np.isfinite(second).all(axis=(1, 2)))
    chosen = np.flatnonzero(both)
    chosen = chosen[np.linspace(0, len(chosen) - 1, min(len(chosen), _SAMPLED_BARS)).astype(int)]
    a, b = first[chosen].reshape(-1, 2), second[chosen].reshape(-1, 2)
    threshold = _EPIPOLAR_PX / float(np.sqrt(nominal[i, 12] * nominal[j, 12]))
    essential, mask = cv2.findEssentialMat(a, b, np.eye(3), cv2.RANSAC, 0.999, threshold, 300)
    if essential is None or essential.shape != (3, 3):
        return None
    n, rotation, translation, mask = cv2.recoverPose(essential, a, b, np.eye(3), mask=mask)
    points = cv2.triangulatePoints(np.eye(3, 4), np.hstack([rotation, translation]), a.T, b.T)
    inside = mask.ravel().reshape(-1, 2).astype(bool).all(axis=1)
    if n < FEWEST_BARS or inside.sum() < FEWEST_BARS // 2:
        return None
    with np.errstate(all="ignore"):
        space = (points[:3] / points[3]).T.reshape(-1, 2, 3)[inside]
    lengths = np.linalg.norm(space[:, 1] - space[:, 0], axis=1)
    middle = float(np.median(lengths))
    spread = float(np.median(np.abs(lengths - middle))) / max(middle, 1e-9)
    if not np.isfinite(spread):
        return None
    return Pair(views, flip, rotation, translation.ravel(), int(n), len(a), spread)
