"""Normal equations of delays and turns, moment by moment, whose poses are eliminated (Schur complement)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tracker.foundation.arrays import Array, Integers
from tracker.results.alignment._looks import POSE_SPREAD, Look
from tracker.results.alignment.moments import Moment

_TURN_SPREAD_PX = 0.5
"""Standard deviation of turns, px at the middle of an image, so that what moving the world would explain is not
ascribed to the cameras; far more pairs speak for a turn that is one."""

_DELAY_SPREAD_FRAMES = 2.0
"""Standard deviation of delays: holds that of a view that shows nothing."""


@dataclass(frozen=True)
class Unknowns:
    """Delays of all views but the first, in frames, once for each part of a recording, and turns of all views."""

    delays: Array
    """(K, V - 1) frames"""

    turns: Array
    """(V, 3) rad"""

    @staticmethod
    def nothing(n_parts: int, n_views: int) -> Unknowns:
        """No view is late, none turned."""
        return Unknowns(np.zeros((n_parts, n_views - 1)), np.zeros((n_views, 3)))

    @property
    def values(self) -> Array:
        """(G,) all in one."""
        every: Array = np.r_[self.delays.ravel(), self.turns.ravel()]
        return every

    def moved(self, step: Array) -> Unknowns:
        """The unknowns a step (G,) further."""
        n = self.delays.size
        return Unknowns(self.delays + step[:n].reshape(self.delays.shape), self.turns + step[n:].reshape(-1, 3))

    def late_frames(self, part: int) -> Array:
        """(V,) delays of all views in a part, frames."""
        late: Array = np.r_[0.0, self.delays[part]]
        return late

    def columns(self, part: int) -> Integers:
        """(4V - 1,) places of what a moment of a part tells of, in `values`."""
        n_delays = self.delays.shape[1]
        own: Integers = part * n_delays + np.arange(n_delays)
        return np.concatenate([own, self.delays.size + np.arange(self.turns.size)])

    def prior(self, focal_px: Array) -> Array:
        """(G, G) how firmly delays and turns are held at nothing, by cameras of such focal lengths (V,), px."""
        firm = [np.full(self.delays.size, 1 / _DELAY_SPREAD_FRAMES), np.repeat(focal_px / _TURN_SPREAD_PX, 3)]
        return np.diag(np.concatenate(firm) ** 2)


@dataclass(frozen=True)
class Eliminated:
    """What a moment says of delays and turns, whatever its pose."""

    matrix: Array
    """(4V - 1, 4V - 1)"""

    vector: Array
    """(4V - 1,)"""

    still: Array
    """(dof,) step of the pose if delays and turns stay."""

    per_unknown: Array
    """(dof, 4V - 1) its change with these."""

    def moved(self, q: Array, step: Array) -> Array:
        """The pose (dof,) that goes with a step of the unknowns (4V - 1,)."""
        pose: Array = q + self.still + self.per_unknown @ step
        return pose


def eliminated(
    moment: Moment, looks: Sequence[Look], q: Array, late_frames: Array, interval_s: float, gate_px: float
) -> Eliminated:
    """The equations of a moment at a pose (dof,) and delays (V,) of the views."""
    person, n_views = moment.scene.persons[moment.person], len(late_frames)
    spread = np.where(person.body.rotates, *POSE_SPREAD)
    matrix, vector = np.diag(spread**-2), (q - person.q) / spread**2
    n_unknowns = 4 * n_views - 1
    crossed, own, right = np.zeros((n_unknowns, len(q))), np.zeros((n_unknowns, n_unknowns)), np.zeros(n_unknowns)
    for look in looks:
        seen = moment.later(q, interval_s * late_frames[look.view])
        residuals, jacobian, by_turn, weights = look.rows(seen, gate_px)
        columns = np.zeros((len(residuals), n_unknowns))
        if look.view:
            columns[:, look.view - 1] = jacobian @ (interval_s * moment.rates[0])
        first = n_views - 1 + 3 * look.view
        columns[:, first : first + 3] = by_turn
        weighted, weighted_columns = weights[:, None] * jacobian, weights[:, None] * columns
        matrix = matrix + jacobian.T @ weighted
        vector = vector + weighted.T @ residuals
        crossed += columns.T @ weighted
        own += columns.T @ weighted_columns
        right += weighted_columns.T @ residuals
    solved = np.linalg.solve(matrix, np.column_stack([vector, crossed.T]))
    return Eliminated(own - crossed @ solved[:, 1:], right - crossed @ solved[:, 0], -solved[:, 0], -solved[:, 1:])


@dataclass(frozen=True)
class Sums:
    """The equations of all moments in the unknowns of the whole recording."""

    matrices: Array
    """(M, G, G)"""

    vectors: Array
    """(M, G)"""

    prior: Array
    """(G, G)"""

    at: Unknowns

    @staticmethod
    def of(told: Sequence[Eliminated], parts: Integers, at: Unknowns, focal_px: Array) -> Sums:
        """Of moments, each in a part (M,) of the recording, at unknowns with as many parts."""
        n = at.values.size
        matrices, vectors = np.zeros((len(told), n, n)), np.zeros((len(told), n))
        for k, (one, part) in enumerate(zip(told, parts, strict=True)):
            columns = at.columns(part)
            matrices[k][np.ix_(columns, columns)] = one.matrix
            vectors[k, columns] = one.vector
        return Sums(matrices, vectors, at.prior(focal_px), at)

    def step(self) -> Array:
        """(G,) from the unknowns to better ones."""
        step: Array = -np.linalg.solve(self.matrices.sum(axis=0) + self.prior, self._slope)
        return step

    @property
    def gain(self) -> float:
        """By how much the step betters the cost, half the sum of weighted squares."""
        return float(-0.5 * self._slope @ self.step())

    def without_each(self) -> Array:
        """(M, G) steps with each moment left out in turn."""
        every = np.arange(len(self.vectors))
        left = [replace(self, matrices=self.matrices[every != k], vectors=self.vectors[every != k]) for k in every]
        return np.array([sums.step() for sums in left])

    @property
    def _slope(self) -> Array:
        slope: Array = self.vectors.sum(axis=0) + self.prior @ self.at.values
        return slope


def jackknife(estimates: Array) -> Array:
    """(...,) standard deviations of what estimates (M, ...) without each of M observations in turn tell."""
    n = len(estimates)
    sigmas: Array = np.sqrt((n - 1) / n * ((estimates - estimates.mean(axis=0)) ** 2).sum(axis=0))
    return sigmas
