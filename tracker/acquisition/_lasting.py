"""Misfit that stays on the body: what clothes and muscles differ from a model by, every look and view shows again.

However many looks show a patch of surface, they tell of its misfit no better than it lasts. Each patch has a departure
of its own, an unknown that drops out of the equations (a random effect: Laird & Ware, Biometrics 38, 1982). Taken for
independent, thousands of contour points of twelve looks drowned all that is known of persons: headings were told to
0.4 degrees, and were 5 off.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tracker.acquisition._residuals import Rows
from tracker.arrays import Array, Integers


@dataclass
class Lasting:
    """The equations of looks, summed up, and what they have in common on each patch."""

    n: int
    """Unknowns: shape, and poses of all looks."""

    share: float
    """Of the variance of a residual: what stays on the body."""

    _found: list[tuple[Integers, Array, Array, Array]] = field(default_factory=list)

    def add(self, rows: Rows, slopes: Array, unknowns: Integers) -> None:
        """Adds a look's rows.

        Args:
            rows: its residuals.
            slopes: (P, 25, U) see `part_slopes`.
            unknowns: (U,) where its unknowns are among all.
        """
        for p in np.unique(rows.parts):
            mine = np.flatnonzero(rows.parts == p)
            patches, places = np.unique(rows.patches[mine], return_inverse=True)
            weighted = rows.weights[mine, None] * rows.asks[mine]
            sums = np.zeros((len(patches), weighted.shape[1]))
            np.add.at(sums, places, weighted)
            totals = _summed(places, rows.weights[mine], len(patches))
            pulls = _summed(places, rows.weights[mine] * rows.residuals[mine], len(patches))
            whole = np.zeros((len(patches), self.n))
            whole[:, unknowns] = sums @ slopes[p]
            self._found.append((patches, totals, pulls, whole))

    def taken_from(self, matrix: Array, vector: Array) -> tuple[Array, Array]:
        """J^T W J (n, n) and J^T W r (n,) of independent residuals without what is known of the patches' departures."""
        if not self._found:
            return matrix, vector
        patches, places = np.unique(np.concatenate([one[0] for one in self._found]), return_inverse=True)
        totals = _summed(places, np.concatenate([one[1] for one in self._found]), len(patches))
        pulls = _summed(places, np.concatenate([one[2] for one in self._found]), len(patches))
        slopes = np.zeros((len(patches), self.n))
        np.add.at(slopes, places, np.concatenate([one[3] for one in self._found]))
        # of a residual's variance 1 - share is its own: weights grow by that, and a departure's is `share`
        own = 1 / (1 - self.share)
        gain = own**2 / (own * totals + 1 / self.share)
        scaled = gain[:, None] * slopes
        return own * matrix - slopes.T @ scaled, own * vector - scaled.T @ pulls


def _summed(places: Integers, values: Array, n: int) -> Array:
    """(n,) sums of values by their places."""
    return np.asarray(np.bincount(places, values, n), dtype=np.float64)
