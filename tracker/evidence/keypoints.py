"""Evidence of keypoints: 2-D detections that a user brings, against the landmarks that they mean.

Robust against persons that are none (the detection nearest to the pose counts), against left and right taken for each
other (a limb may have its sides exchanged) and against single keypoints that are wrong (clamped, and weighed down).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pydantic

from tracker.account import Account
from tracker.arrays import Array, Integers
from tracker.body import BodyModel
from tracker.comparison import Comparison
from tracker.components import PathPattern, component
from tracker.contours import Contours
from tracker.equations import Equations
from tracker.evidence import Evidence, Memory
from tracker.evidence._shares import over_views
from tracker.keypoint_layouts.views import KeypointViews
from tracker.keypoints import landmarks_meant, limbs, swapped_sides
from tracker.rig import Rig
from tracker.sight import Sight

_WORTH_PX = 20.0
"""Contour that a keypoint counts as where lengths are added up, px: of 13 in a view and about 1500 px of contour."""

_EXCHANGED = 0.7
"""The sides of a limb count as exchanged where that leaves less than this share."""


@dataclass(frozen=True)
class ObservedKeypoints:
    """What was detected in a frame."""

    frame: int
    seen: tuple[bool, ...]
    """Views that are not missing."""

    _found: list[tuple[tuple[str, ...], list[Array]]] = field(default_factory=list, repr=False, compare=False)

    def found(self, evidence: KeypointEvidence, rig: Rig) -> tuple[tuple[str, ...], list[Array]]:
        """Names of the keypoints, and for each view (N, K, 3) of N persons, read once."""
        if not self._found:
            views = KeypointViews.open(evidence.path, rig.names, evidence.names)
            found = views.at(self.frame, rig, evidence.downscale, evidence.least_confidence)
            pairs = zip(found, self.seen, strict=True)
            self._found.append((views.names, [view if seen else view[:0] for view, seen in pairs]))
        return self._found[0]


@dataclass(frozen=True)
class _Matched:
    """Landmarks of B poses beside the keypoints that mean them, in V views."""

    marks: Integers
    """(L,) landmarks that have a keypoint."""

    gaps: Array
    """(B, V, L, 2) from keypoint to landmark, px; 0 where there is none."""

    weights: Array
    """(B, V, L) confidences; 0 where there is none."""

    px_per_m: Array
    """(B, V, L) size of a metre there."""

    def distances(self, outlier_m: float) -> Array:
        """(B, V, L) px, at most an outlier's."""
        clamped: Array = np.minimum(np.linalg.norm(self.gaps, axis=-1), outlier_m * self.px_per_m)
        return clamped


@component
class KeypointEvidence(Evidence):
    """Distances of the body's landmarks from the keypoints that a detector has found."""

    path: PathPattern
    """A folder of OpenPose's JSON files, or a CSV table of DeepLabCut or SLEAP, for each view: for instance
    `keypoints/{view}_json`. Their frames are numbered as those of the recording."""

    names: tuple[str, ...] = ()
    """Names of the keypoints in JSON files; empty for those of COCO-17, BODY_25 or HALPE_26, told by their number."""

    downscale: int = pydantic.Field(default=1, ge=1, le=16)
    """As in [reading]: keypoints are in pixels of the recording's own images."""

    least_confidence: float = pydantic.Field(default=0.3, ge=0, le=1)
    """Keypoints of less confidence, a share of 1, are left out."""

    noise_m: float = pydantic.Field(default=0.03, gt=0)
    """Standard deviation of a keypoint from the landmark it means, metres: a detector and a body do not have the same
    joints. BlazePose triangulated from four views is 17 to 45 mm off after constant offsets are removed."""

    outlier_m: float = pydantic.Field(default=0.15, gt=0)
    """Distance at which a keypoint is wrong, metres."""

    def observe(self, sight: Sight, expected: Contours | None, memory: Memory = None) -> ObservedKeypoints:
        """Which frame is asked about; see `tracker.evidence.Evidence.observe`."""
        return ObservedKeypoints(sight.frame.index, tuple(image is not None for image in sight.frame.images))

    def distances(self, asked: Comparison, poses: Array) -> Array:
        """(B,) distance of landmarks and keypoints, averaged over the keypoints and the views that have some, px."""
        return self._averaged(self._per_view(self._matched(asked, poses)), asked.scene.rig)

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """Moves the landmarks to their keypoints, robustly weighted (Geman & McClure).

        The gate does not count: a keypoint says which landmark it is, however far.
        """
        body, rig = asked.body, asked.scene.rig
        matched = self._matched(asked, q[None])
        views, rows = np.nonzero(matched.weights[0] > 0)
        if not len(views):
            return Equations.nothing(body.dof)
        points = body.landmarks_in_world(q)[matched.marks]
        ends = np.array([body.landmarks[k].parameter for k in matched.marks])
        motion = body.point_jacobian(q, points, ends)
        slopes = np.stack([camera.project_jacobian(points) for camera in rig.cameras])
        sizes = matched.px_per_m[0, views, rows]
        residual = matched.gaps[0, views, rows]
        robust = (1 + (np.linalg.norm(residual, axis=1) / (0.5 * self.outlier_m * sizes)) ** 2) ** -2
        weights = matched.weights[0, views, rows] * robust / (self.noise_m * sizes) ** 2
        jacobian = slopes[views, rows] @ motion[rows]
        return Equations.of(residual.ravel(), jacobian.reshape(-1, body.dof), np.repeat(weights, 2))

    def account(self, asked: Comparison, q: Array) -> Account:
        """A keypoint is explained by a landmark within twice the noise; lengths are 20 px a keypoint."""
        body, matched = asked.body, self._matched(asked, q[None])
        distances, present = matched.distances(self.outlier_m)[0], matched.weights[0] > 0
        near = present & (distances < 2 * self.noise_m * matched.px_per_m[0])
        share = np.array([_share_of_parts(body, k) for k in matched.marks]).reshape(-1, len(body.parts))
        visible, explained, total = (values.sum(axis=0) @ share for values in (present, near, distances * present))
        per_view = self._per_view(matched)
        distance_px = float(self._averaged(per_view, asked.scene.rig)[0])
        per_part = total / np.where(visible > 0, visible, np.nan)
        lengths = _WORTH_PX * visible, _WORTH_PX * explained, np.zeros(len(body.parts))
        return Account(distance_px, per_view[0], per_part, *lengths)

    def _per_view(self, matched: _Matched) -> Array:
        """(B, V) weighted mean distance, px; NaN for a view without keypoints."""
        total = matched.weights.sum(axis=2)
        summed = (matched.weights * matched.distances(self.outlier_m)).sum(axis=2)
        per_view: Array = summed / np.where(total > 0, total, np.nan)
        return per_view

    def _averaged(self, per_view: Array, rig: Rig) -> Array:
        """(B,) mean over the views; where there is none, that of outliers 4 m before the first camera."""
        return over_views(per_view, self.outlier_m * float(rig.cameras[0].matrix[0, 0]) / 4)

    def _matched(self, asked: Comparison, poses: Array) -> _Matched:
        """In each view the detection that fits each pose best, with the sides of limbs as they fit best."""
        body, rig = asked.body, asked.scene.rig
        names, found = asked.observed.found(self, rig)
        meant = landmarks_meant(names, body)
        rows = np.flatnonzero(meant >= 0)
        points = body.landmarks_in_world(poses)[:, meant[rows]]
        other = swapped_sides(names, body.mirror)
        groups = [np.flatnonzero(np.isin(rows, limb)) for limb in limbs(names, body.mirror)]
        shape = (len(poses), len(rig), len(rows))
        gaps, weights, sizes = np.zeros((*shape, 2)), np.zeros(shape), np.zeros(shape)
        for v, (camera, persons) in enumerate(zip(rig.cameras, found, strict=True)):
            pixels = camera.project(points)
            sizes[:, v] = camera.matrix[0, 0] / np.maximum(camera.in_camera(points)[..., 2], 0.1)
            if len(persons):
                sides = persons[:, rows], persons[:, other[rows]]
                gaps[:, v], weights[:, v] = _best_person(pixels, *sides, groups, self.outlier_m * sizes[:, v])
        return _Matched(meant[rows], gaps, weights, sizes)


def _best_person(
    pixels: Array, persons: Array, mirrored: Array, groups: Sequence[Integers], outliers: Array
) -> tuple[Array, Array]:
    """Gaps (B, L, 2) and confidences (B, L) of the person that fits each pose best, its limbs as they fit best.

    Args:
        pixels: (B, L, 2) landmarks.
        persons, mirrored: (N, L, 3) keypoints with the sides as detected, and all exchanged.
        groups: landmarks whose sides are exchanged together.
        outliers: (B, L) largest distance that counts, px.
    """
    gaps, confidences = (
        pixels[:, None] - persons[None, :, :, :2],
        np.broadcast_to(persons[None, :, :, 2], (len(pixels), *persons.shape[:2])).copy(),
    )
    swapped = pixels[:, None] - mirrored[None, :, :, :2]
    costs, costs_swapped = (_clamped(one, outliers) for one in (gaps, swapped))
    for group in groups:
        before, after = costs[..., group].sum(axis=-1), costs_swapped[..., group].sum(axis=-1)
        better = (after < _EXCHANGED * before)[..., None]
        confidences[..., group] = np.where(better, mirrored[None, :, group, 2], confidences[..., group])
        gaps[..., group, :] = np.where(better[..., None], swapped[..., group, :], gaps[..., group, :])
        costs[..., group] = np.where(better, costs_swapped[..., group], costs[..., group])
    best = costs.sum(axis=2).argmin(axis=1)
    each = np.arange(len(pixels))
    gaps, confidences = gaps[each, best], confidences[each, best]
    present = np.isfinite(gaps).all(axis=-1) & np.isfinite(confidences)
    return np.where(present[..., None], gaps, 0.0), np.where(present, confidences, 0.0)


def _clamped(gaps: Array, outliers: Array) -> Array:
    """(B, N, L) distances, at most the outlier's, which keypoints that were not found count too."""
    worst = np.broadcast_to(outliers[:, None], gaps.shape[:-1])
    clamped: Array = np.minimum(np.nan_to_num(np.linalg.norm(gaps, axis=-1), nan=np.inf), worst)
    return clamped


def _share_of_parts(body: BodyModel, mark: int) -> Array:
    """(P,) what of a landmark falls to each part: those that its own parameter moves, or all that it hangs on."""
    end = body.landmarks[mark].parameter
    own = body.part_parameters == end
    if not own.any():
        own = body.moves[end, body.part_parameters] if end >= 0 else np.ones(len(body.parts), dtype=np.bool_)
    share: Array = own / max(int(own.sum()), 1)
    return share
