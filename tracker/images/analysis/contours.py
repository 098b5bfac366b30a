"""Edges near the expected contours, accepted or rejected in segments of constant curvature (paper, section 4.2)."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pydantic

from tracker.bodies.contours import Contours, expected_region, expected_samples
from tracker.foundation.arrays import Array32, Image, Mask, Region, frozen
from tracker.foundation.configuration.components import component
from tracker.images.analysis import Analysis, accepted_segments, view_observation
from tracker.images.operations.edges import EdgeSegments, canny, gradient, segment_edges
from tracker.images.sight import Observation, Sight, ViewObservation
from tracker.kernels.edges import marked


@dataclass(frozen=True)
class _ViewLook:
    """Edges of one image in a region, before any expectation."""

    found: EdgeSegments
    trusted: Mask
    """(N,) edge points that the background does not explain."""

    outline: Mask | None
    """(N,) edge points on the outline of the foreground, if a background is known."""


@component
class ContourAnalysis(Analysis):
    """Canny edges, linked, split into constant-curvature segments, filtered by the prediction and the background."""

    smoothing_px: float = pydantic.Field(default=1.0, ge=0)
    """Standard deviation of the Gaussian before the gradient, px."""

    low: float = pydantic.Field(default=3.0, gt=0)
    """Lower hysteresis threshold of the edge detector, grey levels per px."""

    high: float = pydantic.Field(default=7.0, gt=0)
    """Upper hysteresis threshold, grey levels per px."""

    colour: bool = True
    """Use the colour channel that changes most, not the grey value: sleeves of equal brightness show."""

    tangent_px: int = pydantic.Field(default=4, ge=1)
    """Pixels to each side over which a chain's tangent is taken."""

    curvature_deg: float = pydantic.Field(default=20.0, gt=0)
    """Departure of the tangent from constant curvature at which a chain is split, degrees."""

    min_length_px: int = pydantic.Field(default=8, ge=3)
    """Shortest segment kept, px."""

    accept_px: float = pydantic.Field(default=14.0, gt=0)
    """Largest directed chamfer distance of an accepted segment to the expected contours, px."""

    bend_px: float = pydantic.Field(default=20.0, ge=0)
    """Distance that a right angle between edge and expected contour counts, px; 0 ignores directions."""

    margin_px: float = pydantic.Field(default=48.0, ge=0)
    """Region of interest beyond the expected contours, px."""

    reach_px: float = pydantic.Field(default=40.0, gt=0)
    """Value at which the chamfer image is clamped, px."""

    n_scene: int = pydantic.Field(default=400, ge=10)
    """Scene points kept of each view."""

    grow_px: int = pydantic.Field(default=4, ge=0)
    """Edges count this far outside of changed pixels, where a background is known, px."""

    outline_px: int = pydantic.Field(default=3, ge=0)
    """Segments within this distance along the outline of the foreground are always accepted, px; 0 for none. They show
    limbs that the prediction has missed."""

    interior_weight: float = pydantic.Field(default=0.4, ge=0, le=1)
    """Share of its weight that a scene edge inside the foreground has, if a background is known: inside are clothes and
    faces, too, which no pose explains. With 1 a sleeve's pattern outweighs the arm's own edges: a hanging arm was
    placed 100 mm off, and a person was taken for one who faces the other way."""

    use_background: bool = True
    """Reject edges on unchanged pixels, if a background is known."""

    threads: int = pydantic.Field(default=2, ge=1)
    """Views analysed at the same time."""

    ahead_px: float = pydantic.Field(default=40.0, ge=0)
    """Margin for preparing the images of the next frame during the estimation, px; 0 for none."""

    def observe(self, sight: Sight, expected: Contours | None) -> Observation:
        """Scene features of all views; see `tracker.images.analysis.Analysis.observe`."""
        looks = [self._region(sight, expected, v, self.margin_px) for v in range(len(sight.plates))]
        n_views = range(len(looks))

        def view(v: int) -> ViewObservation | None:
            region = looks[v]
            samples = None if expected is None else expected_samples(expected, v)
            return None if region is None else self._observe_view(sight, v, samples, region)

        # What is left after a look takes 3 ms: threads would only wait for the decoders' and the look's.
        ahead = any(region is not None and sight.has(self, v, region) for v, region in enumerate(looks))
        if self.threads == 1 or ahead:
            return Observation(tuple(map(view, n_views)))
        with ThreadPoolExecutor(self.threads) as pool:
            return Observation(tuple(pool.map(view, n_views)))

    def look(self, sight: Sight, around: Contours) -> None:
        """Edges and changes near earlier contours; see `tracker.images.analysis.Analysis.look`."""
        if self.ahead_px == 0:
            return
        for v in range(len(sight.plates)):
            region = self._region(sight, around, v, self.margin_px + self.ahead_px)
            if region is not None:
                self._look_at(sight, v, region)

    def _region(self, sight: Sight, expected: Contours | None, v: int, margin_px: float) -> Region | None:
        """The region of a view to examine: around the contours, or everywhere; None if the view is missing."""
        image = sight.frame.images[v]
        if image is None:
            return None
        size = image.shape[1], image.shape[0]
        return (0, 0, *size) if expected is None else expected_region(expected, v, size, margin_px)

    def _observe_view(self, sight: Sight, v: int, samples: Array32 | None, region: Region) -> ViewObservation:
        look, occluder = self._look_at(sight, v, region), sight.occluder(v)
        accepted = accepted_segments(look.found, samples, self.accept_px, self.bend_px, look.trusted, look.outline)
        observed = view_observation(look.found, accepted, region, self.reach_px, self.n_scene)
        if look.outline is not None:
            observed = _with_interior(observed, look.outline, self.interior_weight)
        return observed if occluder is None else observed.hidden_by(occluder)

    def _look_at(self, sight: Sight, v: int, region: Region) -> _ViewLook:
        def find(where: Region) -> _ViewLook:
            image = sight.frame.images[v]
            assert image is not None
            changes = sight.changes(v, where)
            if changes is None or not self.use_background:
                found = self._segments(image, where)
                return _ViewLook(found, np.ones(len(found.points), dtype=np.bool_), None)
            # Edges count on or beside pixels that have changed; shadows count, for skin may look like one.
            beside = _filtered(changes.moving, cv2.MORPH_DILATE, (self.grow_px, where))
            found = self._segments(image, where, _reached(beside, where))
            trusted, occluder = _at(found, beside), sight.occluder(v)
            if occluder is not None:
                # on its rim as well, where the person is cut off
                trusted &= ~_at(found, _filtered(occluder, cv2.MORPH_DILATE, (self.outline_px, where)))
            return _ViewLook(found, trusted, self._outline(found, changes.silhouette, where))

        return sight.once(self, v, region, find)

    def _segments(self, image: Image, region: Region, near: Image | None = None) -> EdgeSegments:
        """Segments in a region that have a pixel where the image of the region is set, positions in the whole image."""
        x, y, width, height = region
        part = image[y : y + height, x : x + width]
        part = part if self.colour else cv2.cvtColor(part, cv2.COLOR_BGR2GRAY)
        gradients = gradient(part, self.smoothing_px)
        edges = canny(gradients, self.low, self.high)
        rule = (self.tangent_px, float(np.radians(self.curvature_deg)), self.min_length_px)
        found = segment_edges(edges, gradients, rule, near)
        return replace(found, points=found.points + np.array([x, y], dtype=np.float32))

    def _outline(self, found: EdgeSegments, silhouette: Mask, region: Region) -> Mask | None:
        """Points on the outline of the foreground."""
        if self.outline_px == 0:
            return None
        return _at(found, _filtered(silhouette, cv2.MORPH_GRADIENT, (self.outline_px, region)))


def _with_interior(observed: ViewObservation, outline: Mask, weight: float) -> ViewObservation:
    """Less weight for the scene points that are not on the outline (N,)."""
    weights = np.where(outline[observed.scene], np.float32(1), np.float32(weight)) * observed.scene_weights
    return replace(observed, scene_weights=frozen(weights, np.float32))


_Filtered = tuple[Image, tuple[int, int]]
"""Result of a morphological filter on a mask, and the pixel (x, y) of its upper left corner; empty beyond it."""


def _filtered(mask: Mask, operation: int, around: tuple[int, Region]) -> _Filtered:
    """Result of a morphological filter with a disc on a mask.

    Args:
        mask: (H, W) false outside of the region.
        operation: of OpenCV; leaves empty masks empty.
        around: radius of the disc, px, and the region.
    """
    radius_px, region = around
    picture = mask.view(np.uint8)
    x, y, width, height = region
    dx, dy, set_width, set_height = cv2.boundingRect(picture[y : y + height, x : x + width])
    if set_width == 0:
        return np.zeros((1, 1), dtype=np.uint8), (x, y)
    left, top = max(x + dx - radius_px, 0), max(y + dy - radius_px, 0)
    part = picture[top : y + dy + set_height + radius_px, left : x + dx + set_width + radius_px]
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius_px + 1, 2 * radius_px + 1))
    return cv2.morphologyEx(part, operation, disc), (left, top)


def _at(found: EdgeSegments, filtered: _Filtered) -> Mask:
    """Where (N,) a filtered mask is set at the edge points."""
    marks = np.zeros(len(found.points), dtype=np.bool_)
    marked(found.points, *filtered, marks)
    return marks


def _reached(filtered: _Filtered, region: Region) -> Image:
    """Pixels (h, w) of a region from which an edge point may touch a filtered mask: less than one farther."""
    picture, (left, top) = filtered
    framed = cv2.copyMakeBorder(picture, 1, 1, 1, 1, cv2.BORDER_CONSTANT)
    grown, (x, y, width, height) = cv2.dilate(framed, np.ones((3, 3), dtype=np.uint8)), region
    left, top, reached = left - 1 - x, top - 1 - y, np.zeros((height, width), dtype=np.uint8)
    inside = grown[max(-top, 0) : height - top, max(-left, 0) : width - left]
    reached[max(top, 0) :, max(left, 0) :][: inside.shape[0], : inside.shape[1]] = inside
    return reached
