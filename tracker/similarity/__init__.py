"""Similarity: the distance between expected contours and an observation, px, lower is better."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from tracker.arrays import Array
from tracker.contours import Contours
from tracker.observation import Observation


@dataclass(frozen=True)
class Evidence:
    """How well one pose explains the observation."""

    distance_px: float
    """The distance, averaged over the views present, px."""

    per_view_px: Array
    """(V,) px; NaN for a missing view."""

    per_part_px: Array
    """(P,) directed distance of the visible contour of each part to the scene, px; NaN for a hidden part."""

    explained: Array
    """(P,) share of each part's visible contour that lies on scene edges, 0 to 1; NaN for a hidden part."""

    missed_px: Array
    """(P,) scene contour that no model contour explains, counted for the nearest part, px."""

    visible_px: Array
    """(P,) visible contour length of each part over all views, px."""


@runtime_checkable
class Similarity(Protocol):
    """A component that compares contours with an observation."""

    def distance(self, contours: Contours, observation: Observation) -> Array:
        """(B,) distance of each pose, averaged over the views present, px."""
        ...

    def evidence(self, contours: Contours, observation: Observation, n_parts: int) -> Evidence:
        """The distance of the first pose in detail."""
        ...


@runtime_checkable
class Directed(Protocol):
    """A similarity made of directed chamfer distances, which a synthesis may compute itself."""

    @property
    def rule(self) -> tuple[float, bool]:
        """Distance at which a point is an outlier, px; whether outliers are rejected or else clamped."""
        ...

    def combined(self, directed: Array) -> Array:
        """(B,) px: the distance of each pose from its directed distances (B, V, 2)."""
        ...
