"""How much of contours lies on edges, and how much of the edges no contour explains; shared by kinds of evidence."""

from __future__ import annotations

import numpy as np

from tracker.bodies.contours import Contours
from tracker.evidence.measures.account import Account
from tracker.foundation.arrays import Array
from tracker.images.observation import Observation
from tracker.kernels.contours import edge_shares

Distances = tuple[float, Array]


def shares(
    contours: Contours, observation: Observation, n_parts: int, near_px: tuple[float, float], distances: Distances
) -> Account:
    """The account of the first pose, of all parts of the scene.

    Args:
        contours: of the model; samples of weight 0 do not count.
        observation: the edges.
        n_parts: parts of the scene.
        near_px: how close to an edge a sample counts as explained, and how far from all samples an edge as missed.
        distances: of the whole and of each view (V,), NaN where it is missing, px.
    """
    distance_px, per_view_px = distances
    sums, (flat, regions, scene, first, reach) = np.empty((4, len(contours.counts[0]), n_parts)), observation.packed
    samples = contours.positions[0], contours.parts[0], contours.counts[0]
    edge_shares(*samples, flat, regions, scene, first, reach, near_px, sums)
    visible, distance, explained, missed = sums.sum(axis=1)
    seen = np.where(visible > 0, visible, np.nan)
    return Account(distance_px, per_view_px, distance / seen, visible, explained, missed, sums[[0, 2, 3]])


def over_views(per_view: Array, nothing: float) -> Array:
    """Mean over the views that are not missing: (B, V) -> (B,); `nothing` where none is left."""
    present = np.isfinite(per_view)
    n_present = present.sum(axis=1)
    total = np.where(present, per_view, 0.0).sum(axis=1)
    mean: Array = np.where(n_present > 0, total / np.maximum(n_present, 1), nothing)
    return mean
