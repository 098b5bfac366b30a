"""The robust undirected normalized chamfer distance of Gavrila & Davis 1996, section 4.1."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pydantic
from scipy.spatial import cKDTree

from tracker.arrays import Array
from tracker.components import component
from tracker.contours import Contours, ViewContours
from tracker.kernels.chamfer import directed_distances
from tracker.observation import Observation, ViewObservation
from tracker.similarity import Evidence


@component
class ChamferSimilarity:
    """Chamfer distance in both directions between expected contours and accepted scene edges."""

    outlier_px: float = pydantic.Field(default=40.0, gt=0)
    """Distance theta at which a point is an outlier, px."""

    outliers: Literal["clamp", "reject"] = "clamp"
    """`clamp` counts an outlier as theta; `reject` leaves it out, and then every point above mean + 2 sigma, as the
    paper does. Rejection forgets a displaced limb: the distance stays 0 up to 8 degrees off, and the correlation of
    distance and joint error falls from 0.93 to 0.84."""

    explained_px: float = pydantic.Field(default=5.0, gt=0)
    """A contour sample this close to a scene edge counts as explained, px."""

    missed_px: float = pydantic.Field(default=10.0, gt=0)
    """A scene edge farther than this from all model contours counts as missed by the model, px."""

    def distance(self, contours: Contours, observation: Observation) -> Array:
        """(B,) undirected distance (eq. 3), averaged over the views present, px."""
        return self.combined(self._directed(contours, observation))

    @property
    def rule(self) -> tuple[float, bool]:
        """Distance theta, and whether outliers are rejected; see `tracker.similarity.Directed`."""
        return self.outlier_px, self.outliers == "reject"

    def combined(self, directed: Array) -> Array:
        """(B,) the undirected distance from the directed ones (B, V, 2) px."""
        return _over_views(directed.mean(axis=2), self.outlier_px)

    def evidence(self, contours: Contours, observation: Observation, n_parts: int) -> Evidence:
        """The distance of the first pose in detail."""
        per_view = self._directed(contours, observation)[0].mean(axis=1)
        length, distance, near, missed = np.zeros((4, n_parts))
        for v, view in enumerate(observation.views):
            if view is None:
                continue
            model = contours.of(v)
            rounded = np.round(model.pixels).astype(np.int64) - view.origin
            height, width = view.distance.shape
            within = (rounded >= 0).all(axis=1) & (rounded < (width, height)).all(axis=1)
            found = np.full(len(rounded), view.reach)
            found[within] = view.distance[rounded[within, 1], rounded[within, 0]]
            found = np.minimum(found, self.outlier_px)
            length += np.bincount(model.parts, model.weights, n_parts)
            distance += np.bincount(model.parts, model.weights * found, n_parts)
            near += np.bincount(model.parts, model.weights * (found <= self.explained_px), n_parts)
            missed += self._missed(model, view, n_parts)
        seen = np.where(length > 0, length, np.nan)
        average = float(_over_views(per_view[None], self.outlier_px)[0])
        return Evidence(average, per_view, distance / seen, near / seen, missed, length)

    def _missed(self, model: ViewContours, view: ViewObservation, n_parts: int) -> Array:
        """(P,) length of scene contour far from all model contours, by the nearest part."""
        if len(model.parts) == 0 or len(view.scene) == 0:
            return np.zeros(n_parts)
        found = cKDTree(model.pixels).query(view.edges[view.scene])
        gaps, nearest = np.asarray(found[0]), np.asarray(found[1])
        far = gaps > self.missed_px
        lengths = view.scene_weights[far].astype(np.float64)
        missed: Array = np.bincount(model.parts[nearest[far]], lengths, n_parts).astype(np.float64)
        return missed

    def _directed(self, contours: Contours, observation: Observation) -> Array:
        flat, layout, scene, first, _ = observation.packed
        directed: Array = directed_distances(
            contours.positions,
            contours.counts,
            flat,
            layout,
            scene,
            first,
            *self.rule,
        )
        return directed


def _over_views(per_view: Array, worst: float) -> Array:
    """Mean over the views that are not missing: (B, V) -> (B,); `worst` where none is left."""
    present = np.isfinite(per_view)
    n_present = present.sum(axis=1)
    total = np.where(present, per_view, 0.0).sum(axis=1)
    mean: Array = np.where(n_present > 0, total / np.maximum(n_present, 1), worst)
    return mean
