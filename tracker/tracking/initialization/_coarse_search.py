"""The coarse search for a start pose: the body on its axis or in a stance, in all turns, with a few further values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array
from tracker.foundation.errors import ConfigError, ModelError
from tracker.tracking.hypotheses import CoarseValues, apart, coarse_poses, different
from tracker.tracking.initialization._placement import laid_in, placements
from tracker.tracking.initialization._upper_bodies import in_stances
from tracker.tracking.initialization._visual_hull import TorsoAxis
from tracker.tracking.objective import Objective

# Poses at a time: bounds the memory.
_BATCH = 128
# Stances whose landmarks are closer on average lead to the same pose.
_APART_M = 0.25
# The same of upper bodies, whose turns are hardly told by an outline; and so many times as many of them are kept. See
# docs/lab/upper_bodies.md.
_UPPER_APART_M, _UPPER = 0.12, 3
# Limits are kept in rad.
_ROUNDED_DEG = 1e-6


@dataclass(frozen=True)
class CoarseSearch:
    """Poses of one person for a fine search."""

    objective: Objective
    """Objective of the person's pose in a frame."""

    values: CoarseValues
    """Further parameters tried with every turn."""

    turn_step_deg: float
    """Step of the turn over the full circle, degrees."""

    hypotheses: int
    """Largest number of poses kept."""

    apart_deg: float
    """Least difference between the turns of two kept poses, degrees."""

    def along(self, axes: list[TorsoAxis], points: Array) -> list[Array]:
        """The likeliest poses (dof,) of the body laid along any of some axes.

        Args:
            axes: of its trunk.
            points: (N, 3) voxels that show the axis, metres.
        """
        return self._turned([q for axis in axes for q in placements(self.objective.body, axis, points)])

    def low(self, axes: list[TorsoAxis], points: Array) -> list[Array]:
        """The likeliest poses (dof,) of a person too low to stand: head down on the axes, or in one of the stances."""
        body, n = self.objective.body, self.hypotheses
        down = [q for axis in axes if axis.leans for q in placements(body, axis.other_way(points), points)]
        headings = np.radians(self._turns_deg())
        poses = laid_in(body, body.start.stances_deg, points, headings)
        ordered = poses[np.argsort(self._distances(poses), kind="stable")]
        return [*(self._turned(down) if down else ()), *different(body, ordered, n, _APART_M)]

    def upper(self, poses: Array) -> list[Array]:
        """The likeliest poses (dof,) of an upper body among poses (N, dof), and those with the limbs as in the stances.

        All poses are tried with the limbs of the last stance, a quarter with those of the others.
        """
        body, stances = self.objective.body, self.objective.body.start.stances_deg
        order = np.argsort(self._distances(in_stances(body, poses, stances[-1:])), kind="stable")
        likely = in_stances(body, poses[order[: max(len(poses) // 4, self.hypotheses)]], stances)
        ordered = likely[np.argsort(self._distances(likely), kind="stable")]
        return different(body, ordered, _UPPER * self.hypotheses, _UPPER_APART_M)

    def _turned(self, starts: list[Array]) -> list[Array]:
        """The likeliest poses (dof,) among the start poses with all turns and further values, of different turns."""
        body = self.objective.body
        poses = coarse_poses(body, starts, self._turns_deg(), self.values)
        return apart(body, poses, self._distances(poses), (self.hypotheses, self.apart_deg))

    def _turns_deg(self) -> Array:
        return np.arange(-180.0, 180.0, self.turn_step_deg)

    def _distances(self, poses: Array) -> Array:
        return np.concatenate([self.objective(poses[i : i + _BATCH]) for i in range(0, len(poses), _BATCH)])


def check_values(given: CoarseValues | None, body: BodyModel) -> None:
    """Refuses impossible values of the coarse search.

    Args:
        given: parameter -> degrees, as `initialization.coarse_deg` gives them; None for those of the body's file.
        body: gives the parameters and limits.

    Raises:
        ConfigError: a parameter is unknown, has no value, or one outside the limits.
    """
    where = "initialization.coarse_deg" if given is not None else f'start.coarse_deg of model "{body.name}"'
    for name, degrees in (body.start.coarse_deg if given is None else given).items():
        try:
            columns = body.columns(name)
        except ModelError as error:
            raise ConfigError(f"{where}: {error}") from error
        if not degrees:
            raise ConfigError(f'{where}: no value of "{name}", expected some degrees')
        low, high = np.degrees(body.limits[columns].T)
        for value in degrees:
            if (value < low - _ROUNDED_DEG).any() or (value > high + _ROUNDED_DEG).any():
                raise ConfigError(
                    f'{where}: "{name}" is {value:g}, outside the limits {low.max():g} to '
                    f'{high.min():g} deg of model "{body.name}"'
                )
