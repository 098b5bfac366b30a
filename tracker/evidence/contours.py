"""Evidence of contours: edges of the images against the occluding contours of the model (Gavrila & Davis 1996)."""

from __future__ import annotations

import numpy as np
import pydantic
from scipy.spatial import cKDTree

from tracker.account import Account
from tracker.analysis import Analysis
from tracker.analysis.contours import ContourAnalysis
from tracker.arrays import Array
from tracker.comparison import Comparison
from tracker.components import component
from tracker.contours import Contours, ViewContours
from tracker.equations import Equations
from tracker.evidence import Evidence, Memory
from tracker.observation import Observation, ViewObservation
from tracker.sight import Sight
from tracker.similarity import Similarity
from tracker.similarity.chamfer import ChamferSimilarity

# Distance where every view is missing, px: that of an outlier everywhere.
_NOTHING_PX = 40.0


@component
class ContourEvidence(Evidence):
    """Scene edges that an image analysis accepts, compared with the model's contours by a similarity measure."""

    analysis: Analysis = ContourAnalysis()
    """Finds the edges."""

    similarity: Similarity = ChamferSimilarity()
    """Measures how far contours are from them, and says what makes that smaller."""

    explained_px: float = pydantic.Field(default=5.0, gt=0)
    """A contour sample this close to a scene edge counts as explained, px."""

    missed_px: float = pydantic.Field(default=10.0, gt=0)
    """A scene edge farther than this from all model contours counts as missed by the model, px."""

    def look(self, sight: Sight, around: Contours) -> None:
        """Finds edges near earlier contours ahead; see `tracker.evidence.Evidence.look`."""
        self.analysis.look(sight, around)

    def observe(self, sight: Sight, expected: Contours | None, memory: Memory = None) -> Observation:
        """Scene features of all views; see `tracker.evidence.Evidence.observe`."""
        return self.analysis.observe(sight, expected)

    def distances(self, asked: Comparison, poses: Array) -> Array:
        """(B,) the measure's distance, averaged over the views present, px."""
        return _over_views(self.similarity.distances(asked, poses))

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """What makes the distance smaller; see `tracker.evidence.Evidence.equations`."""
        return self.similarity.equations(asked, q, gate_px)

    def account(self, asked: Comparison, q: Array) -> Account:
        """What of the contours lies on edges, and what edges no contour explains."""
        per_view = self.similarity.distances(asked, q[None])
        contours, n_parts = asked.fine(q), len(asked.scene.shapes)
        visible, distance, explained, missed = np.zeros((4, n_parts))
        for v, view in enumerate(asked.observed.views):
            if view is None:
                continue
            model = contours.of(v)
            gaps = _gaps(model, view)
            visible += np.bincount(model.parts, model.weights, n_parts)
            distance += np.bincount(model.parts, model.weights * gaps, n_parts)
            explained += np.bincount(model.parts, model.weights * (gaps <= self.explained_px), n_parts)
            missed += self._missed(model, view, n_parts)
        seen = np.where(visible > 0, visible, np.nan)
        whole = Account(float(_over_views(per_view)[0]), per_view[0], distance / seen, visible, explained, missed)
        return whole.of(asked.own)

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


def _gaps(model: ViewContours, view: ViewObservation) -> Array:
    """(N,) distance of each contour sample to the nearest accepted edge, px; the chamfer image's reach beyond it."""
    rounded = np.round(model.pixels).astype(np.int64) - view.origin
    height, width = view.distance.shape
    within = (rounded >= 0).all(axis=1) & (rounded < (width, height)).all(axis=1)
    found = np.full(len(rounded), view.reach)
    found[within] = view.distance[rounded[within, 1], rounded[within, 0]]
    return found


def _over_views(per_view: Array) -> Array:
    """Mean over the views that are not missing: (B, V) -> (B,)."""
    present = np.isfinite(per_view)
    n_present = present.sum(axis=1)
    total = np.where(present, per_view, 0.0).sum(axis=1)
    mean: Array = np.where(n_present > 0, total / np.maximum(n_present, 1), _NOTHING_PX)
    return mean
