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
from tracker.foundation.arrays import Array, Integers


@dataclass
class Lasting:
    """The equations of looks, summed up, and what they have in common on each patch."""

    n: int
    """Unknowns: shape, and poses of all looks."""

    share: float
    """Of the variance of a residual: what stays on the body; 0 for residuals that are all independent."""

    _found: list[tuple[Integers, Integers, Array, Array]] = field(default_factory=list)
    """Of each look its patches (M,), unknowns (U,), sums of weights and of weighted residuals (M, 2), slopes (M, U)."""

    def add(self, rows: Rows, slopes: Array, unknowns: Integers) -> None:
        """Adds a look's rows.

        Args:
            rows: its residuals.
            slopes: (P, 25, U) see `part_slopes`.
            unknowns: (U,) where its unknowns are among all.
        """
        if not self.share or not len(rows.residuals):
            return
        order = np.argsort(rows.patches, kind="stable")
        patches, first = np.unique(rows.patches[order], return_index=True)
        weights = rows.weights[order]
        sums = np.add.reduceat(np.column_stack([weights, weights * rows.residuals[order]]), first)
        asks = np.add.reduceat(weights[:, None] * rows.asks[order], first)
        parts = rows.parts[order][first]
        found = np.empty((len(patches), len(unknowns)))
        for p in np.unique(parts):
            found[parts == p] = asks[parts == p] @ slopes[p]
        self._found.append((patches, unknowns, sums, found))

    def taken_from(self, matrix: Array, vector: Array) -> tuple[Array, Array]:
        """J^T W J (n, n) and J^T W r (n,) of independent residuals without what is known of the patches' departures."""
        if not self._found:
            return matrix, vector
        patches = np.unique(np.concatenate([one[0] for one in self._found]))
        sums, slopes = np.zeros((len(patches), 2)), np.zeros((len(patches), self.n))
        for own, unknowns, some, found in self._found:
            places = np.searchsorted(patches, own)
            sums[places] += some
            slopes[np.ix_(places, unknowns)] += found
        # of a residual's variance 1 - share is its own: weights grow by that, and a departure's is `share`
        grown = 1 / (1 - self.share)
        gain = grown / np.sqrt(grown * sums[:, 0] + 1 / self.share)
        slopes *= gain[:, None]
        return grown * matrix - slopes.T @ slopes, grown * vector - slopes.T @ (gain * sums[:, 1])
