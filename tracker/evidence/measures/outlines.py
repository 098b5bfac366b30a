"""Data that a person is compared with: outlines of given silhouettes, and everything of a scene except the pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import cv2
import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array, Array32, Integers, Mask, Region
from tracker.images.operations.edges import EdgeSegments, canny, chamfer_image, gradient, segment_edges
from tracker.images.sight import Observation, ViewObservation
from tracker.synthesis import Synthesis

# Direction of the steps of a mask's outline: a choice.
_SMOOTHING_PX = 1.2
# Reach of the chamfer image, from which a search starts.
_REACH_PX = 40.0
# A choice: points beyond add cost and hardly accuracy.
_SCENE_POINTS = 500

# An outline this close to unknown pixels, half of it to either side, is their border.
_BESIDE_PX = 7

# Holes of less than this share of a region are specks of its mask: an arm on the hip encloses a larger one.
_SMALL_HOLE = 0.001

# A sample is on the outline if the model does not cover the pixel this far outside of it, px.
_OUTSIDE_PX = 2.5


def outline_observation(masks: tuple[Mask | None, ...], unknown: tuple[Mask | None, ...] = ()) -> Observation:
    """The outlines of silhouettes as the only edges.

    Args:
        masks: (H, W) of each view, None if unknown.
        unknown: (H, W) unknown pixels of each view: their border is not an outline; None for none.
    """
    pairs = zip(masks, unknown or (None,) * len(masks), strict=True)
    return Observation(tuple(None if mask is None else _outlined(mask, doubted) for mask, doubted in pairs))


def _outlined(mask: Mask, unknown: Mask | None) -> ViewObservation:
    x, y, width, height = _around(mask)
    part = mask[y : y + height, x : x + width]
    gradients = gradient(part.astype(np.uint8) * np.uint8(255), _SMOOTHING_PX)
    found = segment_edges(canny(gradients, 10.0, 20.0), gradients, (4, float(np.radians(20.0)), 8))
    found = replace(found, points=found.points + np.array([x, y], dtype=np.float32))
    kept = _inside(found, mask)
    if unknown is not None:
        beside = cv2.dilate(unknown.view(np.uint8), np.ones((_BESIDE_PX, _BESIDE_PX), np.uint8)) > 0
        kept &= ~_covered(beside, found.points)
    points, directions = found.points[kept], found.directions[kept]
    n = len(points)
    most = min(n, _SCENE_POINTS)
    scene = np.floor((np.arange(most) + 0.5) * n / max(most, 1)).astype(np.int64)
    return ViewObservation(
        edges=points,
        directions=directions,
        segments=found.segments[kept],
        accepted=np.ones(n, dtype=np.bool_),
        scene=scene,
        scene_weights=np.full(most, n / max(most, 1), dtype=np.float32),
        origin=(x, y),
        distance=chamfer_image(points - np.array([x, y], dtype=np.float32), (width, height), _REACH_PX),
        reach=_REACH_PX,
        silhouette=mask,
    )


def _around(mask: Mask) -> Region:
    """The box of the mask and of all pixels near its outline, inside the image."""
    x, y, width, height = cv2.boundingRect(mask.view(np.uint8))
    margin = int(_REACH_PX) + 8
    left, top = max(x - margin, 0), max(y - margin, 0)
    right, bottom = min(x + width + margin, mask.shape[1]), min(y + height + margin, mask.shape[0])
    return left, top, right - left, bottom - top


def _inside(found: EdgeSegments, mask: Mask) -> Mask:
    """(N,) points off the border of the image, where a silhouette that is cut off has no outline."""
    size = np.array([mask.shape[1], mask.shape[0]])
    return np.asarray(((found.points > 2) & (found.points < size - 3)).all(axis=1))


def on_outline(contours: Contours, scene: Scene, synthesis: Synthesis) -> Mask:
    """(V, M) samples of the first pose that lie on the outline of the whole model, not before another part."""
    positions = contours.positions[0]
    found = np.zeros(positions.shape[:2], dtype=np.bool_)
    for v, silhouette in enumerate(synthesis.silhouettes(scene)):
        n = int(contours.counts[0, v])
        found[v, :n] = ~_covered(silhouette, positions[v, :n, :2] + _OUTSIDE_PX * positions[v, :n, 2:4])
    return found


def _covered(silhouette: Mask, pixels: Array32) -> Mask:
    columns, rows = np.rint(pixels).astype(np.int64).T
    height, width = silhouette.shape
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    covered: Mask = silhouette[rows.clip(0, height - 1), columns.clip(0, width - 1)] & inside
    return covered


def overlap(one: Mask, other: Mask) -> float:
    """Intersection over union of two silhouettes."""
    union = np.count_nonzero(one | other)
    return np.count_nonzero(one & other) / union if union else 0.0


def largest_region(mask: Mask) -> Mask:
    """The largest connected region, its small holes filled."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    if count < 2:
        return mask
    region: Mask = labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    _, labels, stats, _ = cv2.connectedComponentsWithStats((~region).astype(np.uint8), connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] < _SMALL_HOLE * np.count_nonzero(region)
    filled: Mask = region | small[labels]
    return filled


_Found = TypeVar("_Found")


@dataclass(frozen=True)
class Comparison:
    """The question to a kind of evidence (paper, figure 1b).

    The other persons of the scene stay at their poses: earlier ones at their best, later ones as predicted.
    """

    scene: Scene
    person: int
    synthesis: Synthesis
    observed: Any
    """Observation of this kind, as its `observe` returned it."""

    _last: dict[str, tuple[bytes, Any]] = field(default_factory=dict, repr=False, compare=False)

    def put(self, observed: Any) -> Comparison:
        """The same question for a kind of evidence with another observation."""
        return Comparison(self.scene, self.person, self.synthesis, observed, self._last)

    def with_contours(self, q: Array, contours: Contours) -> Comparison:
        """The same question with other contours of a pose (dof,) than the synthesis makes."""
        return Comparison(
            self.scene, self.person, self.synthesis, self.observed, {**self._last, "fine": (q.tobytes(), contours)}
        )

    @property
    def body(self) -> BodyModel:
        """The model whose pose is sought."""
        return self.scene.persons[self.person].body

    @property
    def own(self) -> slice:
        """The person's parts among those of the scene."""
        first = self.scene.first_part(self.person)
        return slice(first, first + len(self.body.parts))

    @property
    def ends(self) -> Integers:
        """(P,) last pose parameter that moves each part of the scene; -2 for the parts of other persons.

        A sample of a smooth skin counts as its strongest part's. The exact derivative of the surface is the weighted
        sum over all parts that move it, but refinements with it were worse in most starts and took twice as long; see
        the results.
        """

        def find() -> Integers:
            found = np.full(len(self.scene.shapes), -2, dtype=np.int64)
            found[self.own] = self.body.part_parameters
            return found

        return self._once("ends", b"", find)

    def placements(self, poses: Array) -> Array:
        """(B, P, 4, 4) see `Scene.world_from_parts`, with the person at each of the poses (B, dof)."""
        return self.scene.world_from_parts(self.person, poses)

    def twists(self, q: Array) -> Array:
        """(dof, 6) spatial twists at a pose (dof,), kept until another one is asked for."""
        return self._once("twists", q.tobytes(), lambda: self.body.twists(q))

    def contours(self, poses: Array, coarse: bool = False) -> Contours:
        """Expected contours of the scene with the person at each of the poses (B, dof).

        Args:
            poses: rad and m.
            coarse: dense enough to rank many poses; see `tracker.synthesis.Synthesis.contours`.
        """
        return self.synthesis.contours(self.scene, self.person, poses, coarse)

    def fine(self, q: Array) -> Contours:
        """The contours of one pose (dof,), kept until the next pose: several kinds of evidence need them."""
        return self._once("fine", q.tobytes(), lambda: self.contours(q[None]))

    def _once(self, what: str, key: bytes, find: Callable[[], _Found]) -> _Found:
        """The value for the last key; computed anew for another one."""
        kept = self._last.get(what)
        if kept is None or kept[0] != key:
            kept = self._last[what] = key, find()
        found: _Found = kept[1]
        return found
