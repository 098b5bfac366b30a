"""Evidence of contours: edges of the images against the occluding contours of the model (Gavrila & Davis 1996)."""

from __future__ import annotations

import numpy as np
import pydantic

from tracker.bodies.contours import PX_PER_OBSERVATION, Contours
from tracker.evidence import Evidence, EvidencePicture, Memory
from tracker.evidence._shares import UNKNOWN, over_views, shares
from tracker.evidence.measures.account import Account
from tracker.evidence.measures.correspondences import Equations
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.similarity import Similarity
from tracker.evidence.similarity.chamfer import ChamferSimilarity
from tracker.foundation.arrays import Array, Array32, Image
from tracker.foundation.configuration.components import component
from tracker.images.analysis import Analysis
from tracker.images.analysis.contours import ContourAnalysis
from tracker.images.sight import Observation, Sight, ViewObservation
from tracker.kernels.descent import Edges, Kinds

# Distance where every view is missing, px: that of an outlier everywhere.
_NOTHING_PX = 40.0


@component
class ContourEvidence(Evidence):
    """Scene edges that an image analysis accepts, compared with the model's contours by a similarity measure."""

    analysis: Analysis = ContourAnalysis()
    """Finds the edges."""

    similarity: Similarity = ChamferSimilarity()
    """Measures the distance of contours from them, and its derivatives."""

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
        return over_views(self.similarity.distances(asked, poses), _NOTHING_PX)

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """Equations that reduce the distance; see `tracker.evidence.Evidence.equations`."""
        return self.similarity.equations(asked, q, gate_px)

    def kinds(self, asked: Comparison) -> Kinds | None:
        """The edges, if the measure is the chamfer distance without votes."""
        measure = self.similarity
        if type(self) is not ContourEvidence or not isinstance(measure, ChamferSimilarity) or measure.votes:
            return None
        edges, cosine = asked.observed.packed, float(np.cos(np.radians(measure.direction_deg)))
        return Kinds(edges=Edges(1.0, 0.0, edges.points, edges.first, cosine, PX_PER_OBSERVATION))

    def account(self, asked: Comparison, q: Array) -> Account:
        """Contours on edges, and edges that no contour explains."""
        per_view = self.similarity.distances(asked, q[None])
        distances = float(over_views(per_view, _NOTHING_PX)[0]), per_view[0]
        near_px = self.explained_px, self.missed_px
        return shares(asked.fine(q), asked.observed, len(asked.scene.shapes), near_px, distances).of(asked.own)

    def pictures(self, asked: Comparison, sight: Sight, view: int) -> tuple[EvidencePicture, ...]:
        """Edges, accepted edges and the chamfer image, as in figure 6 of Gavrila & Davis."""
        seen, image = asked.observed.views[view], sight.frame.images[view]
        if seen is None or image is None:
            return (EvidencePicture("contours: the view has no image", None),)
        return (
            EvidencePicture("edges", _marked(image.shape, seen.edges)),
            EvidencePicture("accepted edges", _marked(image.shape, seen.edges[seen.accepted])),
            EvidencePicture("chamfer image", _chamfer_picture(image.shape, seen)),
        )


def _marked(shape: tuple[int, ...], points: Array32) -> Image:
    """Points (N, 2) white on black, px."""
    picture = np.zeros(shape, dtype=np.uint8)
    x, y = np.clip(np.rint(points).astype(np.int64), 0, np.array([shape[1], shape[0]]) - 1).T
    picture[y, x] = 255
    return picture


def _chamfer_picture(shape: tuple[int, ...], seen: ViewObservation) -> Image:
    """Distances as grey: black on an edge, white at the reach and beyond; blue where something hides the persons."""
    grey, (x, y), (height, width) = np.full(shape[:2], 255, np.uint8), seen.origin, seen.distance.shape
    grey[y : y + height, x : x + width] = np.clip(255 * seen.distance / seen.reach, 0, 255)
    picture = np.repeat(grey[..., None], 3, axis=2)
    picture[y : y + height, x : x + width][seen.distance < 0] = UNKNOWN
    return picture
