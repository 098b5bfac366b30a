"""Best-first search over a decomposed pose space (Gavrila & Davis 1996, section 4.1, eqs. 4-7)."""

from __future__ import annotations

import heapq
from collections.abc import Generator

import numpy as np
import pydantic

from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array, Integers
from tracker.foundation.configuration.components import component
from tracker.tracking.estimate import Estimate
from tracker.tracking.objective import Objective


@component
class BestFirstEstimation:
    """Searches a lattice of poses around the prediction, one parameter group after the other.

    Each group is searched with the others held: earlier ones at the best pose so far, later ones as predicted.
    """

    decomposition: tuple[str, ...] = ()
    """Parameter groups of the body model, in the order in which they are searched; empty for the model's coarse
    groups: torso_head, arms, legs."""

    range_m: float = pydantic.Field(default=0.10, gt=0)
    """Largest departure of a translation from the prediction, metres."""

    range_deg: float = pydantic.Field(default=15.0, gt=0)
    """Largest departure of an angle from the prediction, degrees."""

    step_m: float = pydantic.Field(default=0.05, gt=0)
    """Lattice step of translations, metres."""

    step_deg: float = pydantic.Field(default=5.0, gt=0)
    """Lattice step of angles, degrees."""

    halvings: int = pydantic.Field(default=0, ge=0, le=6)
    """Times the search is repeated around its result with half the steps and ranges."""

    patience: int = pydantic.Field(default=4, ge=1)
    """Expansions without an improvement after which a group's search ends."""

    max_expansions: int = pydantic.Field(default=60, ge=1)
    """Most nodes expanded for a group."""

    def estimate(self, objective: Objective, starts: Array) -> Estimate:
        """The best lattice pose around the best of the starts."""
        distances = objective(starts)
        q, n_evaluations = starts[int(np.argmin(distances))], len(starts)
        for level in range(self.halvings + 1):
            q, n = self.search_level(objective, q, level)
            n_evaluations += n
        unknown = np.full((objective.body.dof, objective.body.dof), np.nan)
        return objective.estimate(q, unknown, n_evaluations)

    def search_level(self, objective: Objective, q: Array, level: int) -> tuple[Array, int]:
        """Searches all groups around a pose (dof,) after some halvings: the best pose and the number evaluated."""
        n_evaluations = 0
        for group in self.decomposition or objective.body.coarse_groups:
            q, n = self.search_group(objective, q, objective.body.group(group), 0.5**level)
            n_evaluations += n
        return q, n_evaluations

    def search_group(self, objective: Objective, q: Array, columns: Integers, scale: float = 1.0) -> tuple[Array, int]:
        """Best-first search of some parameters, the others held.

        Args:
            objective: poses (B, dof) -> distances (B,) px.
            q: (dof,) centre of the lattice.
            columns: (n,) parameters searched.
            scale: factor on steps and ranges.

        Returns:
            The best pose (dof,) and the number of poses evaluated.
        """
        search, n_evaluations = self._search(objective.body, q, columns, scale), 0
        asked = next(search)
        while True:
            n_evaluations += len(asked)
            try:
                asked = search.send(objective(asked))
            except StopIteration as end:
                return end.value, n_evaluations

    def _search(self, body: BodyModel, q: Array, columns: Integers, scale: float) -> Generator[Array, Array, Array]:
        """One search: yields poses (B, dof), is sent their distances (B,), and returns the best pose (dof,)."""
        rotates = body.rotates[columns]
        steps = scale * np.where(rotates, np.radians(self.step_deg), self.step_m)
        reach = np.where(rotates, round(self.range_deg / self.step_deg), round(self.range_m / self.step_m))
        lattice = _Lattice(body, q, columns, steps, reach.astype(np.int64))
        best = (0,) * len(columns)
        best_distance = float((yield q[None])[0])
        frontier, seen, idle = [(best_distance, best)], {best}, 0
        for _ in range(self.max_expansions):
            if not frontier or idle >= self.patience:
                break
            _, node = heapq.heappop(frontier)
            fresh = [other for other in lattice.neighbours(node) if other not in seen]
            idle += 1
            if not fresh:
                continue
            seen.update(fresh)
            distances = yield lattice.poses(fresh)
            for distance, other in zip(distances.tolist(), fresh, strict=True):
                heapq.heappush(frontier, (distance, other))
                if distance < best_distance - 1e-9:
                    best_distance, best, idle = distance, other, 0
        found: Array = lattice.poses([best])[0]
        return found


class _Lattice:
    """Poses at whole steps around a centre, inside the search range and the joint limits."""

    def __init__(self, body: BodyModel, centre: Array, columns: Integers, steps: Array, reach: Integers) -> None:
        self._centre, self._columns, self._steps = centre, columns, steps
        low, high = body.limits[columns].T
        self._lowest = np.maximum(-reach, np.ceil((low - centre[columns]) / steps - 1e-9))
        self._highest = np.minimum(reach, np.floor((high - centre[columns]) / steps + 1e-9))

    def neighbours(self, node: tuple[int, ...]) -> list[tuple[int, ...]]:
        """Nodes one step away in one parameter."""
        found = []
        for k, value in enumerate(node):
            if value + 1 <= self._highest[k]:
                found.append((*node[:k], value + 1, *node[k + 1 :]))
            if value - 1 >= self._lowest[k]:
                found.append((*node[:k], value - 1, *node[k + 1 :]))
        return found

    def poses(self, nodes: list[tuple[int, ...]]) -> Array:
        """(N, dof) poses of lattice nodes."""
        poses = np.tile(self._centre, (len(nodes), 1))
        poses[:, self._columns] += np.array(nodes) * self._steps
        return poses
