"""Outlines of the foreground as the only edges: for clean plates, if clothing and clutter disturb."""

from __future__ import annotations

import cv2
import numpy as np
import pydantic

from tracker.bodies.contours import Contours, expected_samples, region_around
from tracker.foundation.arrays import Array32, Image, Mask
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import SequenceError
from tracker.images.analysis import Analysis, accepted_segments, view_observation
from tracker.images.operations.edges import canny, gradient, segment_edges
from tracker.images.sight import Observation, Sight, ViewObservation

# An outline this close to a thing before a person belongs to that thing: as far as smoothing moves it.
_RIM_PX = 3


@component
class SilhouetteAnalysis(Analysis):
    """Edges of the background-subtracted silhouettes."""

    smoothing_px: float = pydantic.Field(default=1.5, gt=0)
    """Smoothing of the silhouette before its outline is taken, px."""

    accept_px: float = pydantic.Field(default=20.0, gt=0)
    """Largest directed chamfer distance of an accepted segment to the expected contours, px."""

    bend_px: float = pydantic.Field(default=20.0, ge=0)
    """Distance that a right angle between outline and expected contour counts, px."""

    margin_px: float = pydantic.Field(default=48.0, ge=0)
    """Region of interest beyond the expected contours, px."""

    reach_px: float = pydantic.Field(default=40.0, gt=0)
    """Value at which the chamfer image is clamped, px."""

    n_scene: int = pydantic.Field(default=400, ge=10)
    """Scene points kept of each view."""

    def observe(self, sight: Sight, expected: Contours | None) -> Observation:
        """Scene features of all views; see `tracker.images.analysis.Analysis.observe`.

        Raises:
            SequenceError: a view has no background plate, and there are no masks.
        """
        # Where masks are brought, a view may lack one in a frame, as it may lack its image.
        if not sight.frame.masks and any(plate is None for plate in sight.plates):
            raise SequenceError(
                "silhouettes need the background of every view: add "
                '`background = "background/{view}.png"` (or masks) to [reading], or use = "contours" in '
                "[evidence.analysis]"
            )
        views = []
        for v, image in enumerate(sight.frame.images):
            samples = None if expected is None else expected_samples(expected, v)
            views.append(None if image is None else self._observe_view(sight, v, image, samples))
        return Observation(tuple(views))

    def _observe_view(self, sight: Sight, v: int, image: Image, samples: Array32 | None) -> ViewObservation | None:
        size = image.shape[1], image.shape[0]
        region = (0, 0, *size) if samples is None else region_around(samples, size, self.margin_px)
        changes = sight.changes(v, region)
        if changes is None:  # not to be trusted
            return None
        gradients = gradient(cv2.convertScaleAbs(changes.silhouette.astype(np.uint8), alpha=255), self.smoothing_px)
        found = segment_edges(canny(gradients, 10.0, 20.0), gradients, (4, float(np.radians(20.0)), 8))
        occluder = sight.occluder(v)
        trusted = np.ones(len(found.points), dtype=np.bool_) if occluder is None else ~_beside(occluder, found.points)
        accepted = accepted_segments(found, samples, self.accept_px, self.bend_px, trusted)
        observed = view_observation(found, accepted, region, self.reach_px, self.n_scene)
        return observed if occluder is None else observed.hidden_by(occluder)


def _beside(occluder: Mask, points: Array32) -> Mask:
    """Points (N, 2) on or beside things before the persons (H, W), where an outline is cut off."""
    near = cv2.dilate(occluder.view(np.uint8), np.ones((2 * _RIM_PX + 1,) * 2, np.uint8)) > 0
    columns, rows = np.rint(points).astype(np.int64).T
    found: Mask = near[rows.clip(0, len(near) - 1), columns.clip(0, near.shape[1] - 1)]
    return found
