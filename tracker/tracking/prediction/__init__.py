"""Prediction: candidate poses for the next frame from the poses so far."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array
from tracker.tracking.trajectory import History


@runtime_checkable
class Prediction(Protocol):
    """A component that extrapolates a person's motion."""

    def predict(self, body: BodyModel, history: History, time_s: float) -> Array:
        """Candidate poses at a later time.

        Args:
            body: gives the joint limits.
            history: poses so far, at least one.
            time_s: time to predict for, seconds.

        Returns:
            (C, dof) candidates, the preferred one first, rad and m.
        """
        ...
