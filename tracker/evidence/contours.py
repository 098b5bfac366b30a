"""Evidence of contours: edges of the images against the occluding contours of the model (Gavrila & Davis 1996)."""

from __future__ import annotations

import pydantic

from tracker.bodies.contours import Contours
from tracker.evidence import Evidence, Memory
from tracker.evidence._shares import over_views, shares
from tracker.evidence.measures.account import Account
from tracker.evidence.measures.comparison import Comparison
from tracker.evidence.measures.equations import Equations
from tracker.evidence.similarity import Similarity
from tracker.evidence.similarity.chamfer import ChamferSimilarity
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.images.analysis import Analysis
from tracker.images.analysis.contours import ContourAnalysis
from tracker.images.observation import Observation
from tracker.images.sight import Sight

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
        return over_views(self.similarity.distances(asked, poses), _NOTHING_PX)

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """What makes the distance smaller; see `tracker.evidence.Evidence.equations`."""
        return self.similarity.equations(asked, q, gate_px)

    def account(self, asked: Comparison, q: Array) -> Account:
        """What of the contours lies on edges, and what edges no contour explains."""
        per_view = self.similarity.distances(asked, q[None])
        distances = float(over_views(per_view, _NOTHING_PX)[0]), per_view[0]
        near_px = self.explained_px, self.missed_px
        return shares(asked.fine(q), asked.observed, len(asked.scene.shapes), near_px, distances).of(asked.own)
