"""How much of contours lies on edges, and how much of the edges no contour explains; shared by kinds of evidence."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from tracker.account import Account
from tracker.arrays import Array
from tracker.contours import Contours, ViewContours
from tracker.observation import Observation, ViewObservation

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
    visible, distance, explained, missed = np.zeros((4, n_parts))
    for v, view in enumerate(observation.views):
        if view is None:
            continue
        model = contours.of(v)
        gaps = _gaps(model, view)
        visible += np.bincount(model.parts, model.weights, n_parts)
        distance += np.bincount(model.parts, model.weights * gaps, n_parts)
        explained += np.bincount(model.parts, model.weights * (gaps <= near_px[0]), n_parts)
        missed += _missed(model, view, n_parts, near_px[1])
    seen = np.where(visible > 0, visible, np.nan)
    return Account(distance_px, per_view_px, distance / seen, visible, explained, missed)


def over_views(per_view: Array, nothing: float) -> Array:
    """Mean over the views that are not missing: (B, V) -> (B,); `nothing` where none is left."""
    present = np.isfinite(per_view)
    n_present = present.sum(axis=1)
    total = np.where(present, per_view, 0.0).sum(axis=1)
    mean: Array = np.where(n_present > 0, total / np.maximum(n_present, 1), nothing)
    return mean


def _gaps(model: ViewContours, view: ViewObservation) -> Array:
    """(N,) distance of each contour sample to the nearest accepted edge, px; the chamfer image's reach beyond it."""
    rounded = np.round(model.pixels).astype(np.int64) - view.origin
    height, width = view.distance.shape
    within = (rounded >= 0).all(axis=1) & (rounded < (width, height)).all(axis=1)
    found = np.full(len(rounded), view.reach)
    found[within] = view.distance[rounded[within, 1], rounded[within, 0]]
    return found


def _missed(model: ViewContours, view: ViewObservation, n_parts: int, missed_px: float) -> Array:
    """(P,) length of scene contour far from all model contours, by the nearest part."""
    if len(model.parts) == 0 or len(view.scene) == 0:
        return np.zeros(n_parts)
    found = cKDTree(model.pixels).query(view.edges[view.scene])
    gaps, nearest = np.asarray(found[0]), np.asarray(found[1])
    far = gaps > missed_px
    lengths = view.scene_weights[far].astype(np.float64)
    missed: Array = np.bincount(model.parts[nearest[far]], lengths, n_parts).astype(np.float64)
    return missed
