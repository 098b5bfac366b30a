"""Estimation: from an objective and start poses to the pose that explains the images best."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from tracker.foundation.arrays import Array
from tracker.tracking.estimate import Estimate
from tracker.tracking.objective import Objective


@runtime_checkable
class Estimation(Protocol):
    """A component that finds a person's pose."""

    def estimate(self, objective: Objective, starts: Array) -> Estimate:
        """The best pose near the starts.

        Args:
            objective: distances of poses of one person, everything else fixed.
            starts: (C, dof) candidate predictions, the preferred one first, rad and m.

        Returns:
            The pose with its evidence; the tracking decides on its status.
        """
        ...
