"""The robust undirected normalized chamfer distance of Gavrila & Davis 1996, section 4.1."""

from __future__ import annotations

from typing import Literal

import pydantic

from tracker.bodies.contours import PX_PER_OBSERVATION
from tracker.evidence.measures.correspondences import Equations, limbs_of, oriented_pairs, voted_pairs
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.kernels.contours import normal_equations


@component
class ChamferSimilarity:
    """Chamfer distance in both directions between expected contours and accepted scene edges."""

    outlier_px: float = pydantic.Field(default=40.0, gt=0)
    """Distance theta at which a point is an outlier, px."""

    outliers: Literal["clamp", "reject"] = "clamp"
    """`clamp` counts an outlier as theta; `reject` leaves it out, and then every point above mean + 2 sigma, as the
    paper does. Rejection forgets a displaced limb: the distance stays 0 up to 8 degrees off, and the correlation of
    distance and joint error falls from 0.93 to 0.84."""

    direction_deg: float = pydantic.Field(default=40.0, gt=0, le=90)
    """Largest angle between the normal of the model contour and the scene's gradient in a refinement, degrees."""

    votes: bool = False
    """Pair a segment of edges with only one limb in a refinement: the one nearest to most of its points."""

    def distances(self, asked: Comparison, poses: Array) -> Array:
        """(B, V) undirected distance (eq. 3) in each view; see `tracker.evidence.similarity.Similarity.distances`."""
        directed = asked.synthesis.directed_distances(
            asked.scene, asked.person, poses, asked.observed, self.outlier_px, self.outliers == "reject"
        )
        both_ways: Array = directed.mean(axis=2)
        return both_ways

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """Oriented nearest neighbours both ways, their residuals along the contour normals robustly weighted."""
        contours, edges = asked.fine(q), asked.observed.packed
        if self.votes:
            pairs = voted_pairs(asked, contours, gate_px, self.direction_deg, limbs_of(asked.scene))
        else:
            pairs = oriented_pairs(contours, edges, gate_px, self.direction_deg)
        found = normal_equations(
            pairs,
            contours.positions[0],
            contours.points[0],
            contours.parts[0],
            asked.ends,
            edges.points,
            asked.scene.rig.packed,
            asked.twists(q),
            asked.body.moves,
            PX_PER_OBSERVATION,
            0.5 * gate_px,
        )
        return Equations(*found)
