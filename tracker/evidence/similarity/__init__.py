"""Similarity: a measure of the distance between expected contours and the edges of the images, px, lower is better."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from tracker.evidence.measures.correspondences import Equations
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.arrays import Array


@runtime_checkable
class Similarity(Protocol):
    """A component that compares contours with edges: `asked.observed` is an `Observation`."""

    def distances(self, asked: Comparison, poses: Array) -> Array:
        """Distance of each pose (B, dof) in each view: (B, V) px; NaN for a missing view.

        Contours are coarse (`asked.contours(poses, coarse=True)`), because it ranks many poses.
        """
        ...

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """Equations that reduce the distance, linearized at a pose (dof,), of pairs no farther apart than `gate_px`."""
        ...
