"""How much of what two views are known to show a surface measurement has reached, and why not more."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from tracker.foundation.arrays import Array

# Below half of the region, a surface is no success.
_ENOUGH = 0.5


@dataclass(frozen=True)
class Attempt:
    """What the measurement of one search image started from."""

    at: Array
    """(N, 2) template pixels that are known to be visible in both views."""

    n_seeds: int
    """Cells that growth started from."""

    faults: tuple[str, ...]
    """Why the others failed as seeds, a text for each."""


@dataclass(frozen=True)
class Coverage:
    """What became of the places that template and search image are known to have in common."""

    n_candidates: int
    """Approximate correspondences: image features that look alike and agree with the rig, or given seeds."""

    n_covered: int
    """Those of them with a measured point within reach."""

    n_seeds: int
    """Cells that growth started from."""

    faults: tuple[str, ...]
    """Why candidates failed as seeds, a text for each."""

    @property
    def share(self) -> float:
        """Of the candidates that are covered."""
        return self.n_covered / max(self.n_candidates, 1)

    def warning(self, template: str, search: str) -> str | None:
        """What to say of a surface that covers less than half of what the views are known to show."""
        if self.share >= _ENOUGH:
            return None
        said = f"{template} - {search}: the surface covers {self.n_covered} of {self.n_candidates} places that both "
        said += f"views are known to show ({100 * self.share:.0f} %): it is not complete"
        if self.faults:
            reasons = ", ".join(f"{n} {why}" for why, n in Counter(self.faults).most_common(3))
            said += f"; {len(self.faults)} of {self.n_candidates} seeds failed: {reasons}"
        return said + "; try another matching.patch_px, views nearer to one another, or preparation.enhance_contrast"


def coverage_of(attempt: Attempt, at: Array, reach_px: float) -> Coverage:
    """What became of an attempt, where points were measured at template pixels (N, 2)."""
    n = len(attempt.at)
    gaps = cKDTree(at).query(attempt.at)[0] if len(at) and n else np.full(n, np.inf)
    return Coverage(n, int((np.asarray(gaps) <= reach_px).sum()), attempt.n_seeds, attempt.faults)
