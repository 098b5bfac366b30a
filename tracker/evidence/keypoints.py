"""Evidence of keypoints: 2-D detections from a user's files, against the points of the body that they mean.

It is robust against detections of other things (the detection that fits a pose best counts), against exchanged sides (a
limb may have its sides exchanged, at a price) and against single wrong keypoints (their loss
is bounded: S. Geman, D. McClure, Statistical methods for tomographic image reconstruction, 1987).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pydantic

from tracker.bodies.body import BodyModel
from tracker.bodies.contours import Contours
from tracker.bodies.keypoint_layouts.views import KeypointFiles, fitting_layout
from tracker.bodies.keypoints import Meant, limbs, meant, swapped_sides
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.evidence import Evidence, EvidencePicture, Memory
from tracker.evidence._shares import gaps_picture, over_views
from tracker.evidence.measures.account import Account
from tracker.evidence.measures.correspondences import Equations
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.arrays import Array, frozen
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import ConfigError, SequenceError
from tracker.images.sight import Sight
from tracker.kernels.body import Detected, Matches, match_keypoints

_WORTH_PX = 60.0
"""Contour that a keypoint counts as in sums of lengths, px: an arm's keypoints in four views count as its contours.
Wrongly learnt colours then do not outvote views that agree on a limb's place. Beside contours and colours, without
plates, 31 of 40 frames were flagged with 20 px, 2 of them rightly; with 60 px 11 of 24, 3 rightly:
docs/lab/detections_beside.md."""

_EXCHANGE_COSTS = 0.25
"""Price of exchanging a keypoint's sides, share of an outlier. It is less than any keypoint on the wrong side of a body
loses, and more than where two lie beside each other; without it a body turned round fits as well as the right one."""

_NEAR = 0.5
"""Largest loss of a keypoint that agrees with the pose: nearer than half of `outlier_m`."""

_SOMEBODY_ELSE = 0.8
"""Mean loss of a detection above which it is of another person, and says nothing about this one."""


@dataclass(frozen=True)
class _Known:
    """Detections of the keypoints that mean points of a body."""

    meant: Meant
    detected: Detected

    @property
    def n_limbs(self) -> int:
        """Number of limbs with sides."""
        return int(self.detected.limbs.max(initial=-1)) + 1


@dataclass(frozen=True)
class ObservedKeypoints:
    """Detections in a frame."""

    frame: Frame
    """Views without images have no keypoints."""

    seen: tuple[bool, ...]
    """Views that are not missing."""

    _known: dict[int, _Known] = field(default_factory=dict, repr=False, compare=False)

    def about(self, asked: Comparison, evidence: KeypointEvidence) -> _Known:
        """Keypoints that mean points of the person, read and packed once."""
        if asked.person not in self._known:
            rig = asked.scene.rig
            views = evidence.opened(rig)
            found = evidence.found(views, self.frame, rig)
            found = [view if seen else view[:0] for view, seen in zip(found, self.seen, strict=True)]
            self._known[asked.person] = _packed(views.names, found, asked.body)
        return self._known[asked.person]


def _packed(names: tuple[str, ...], found: Sequence[Array], body: BodyModel) -> _Known:
    """The keypoints that mean points of a body."""
    points = meant(names, body)
    other = swapped_sides(names, body.mirror)
    place = np.full(len(names), -1, dtype=np.int64)
    place[points.rows] = np.arange(len(points.rows))
    groups = np.full(len(points.rows), -1, dtype=np.int64)
    for n, limb in enumerate(limbs(names, body)):
        groups[place[limb[place[limb] >= 0]]] = n
    partners = place[other[points.rows]]
    alone = partners < 0
    detections = np.concatenate([np.zeros((0, len(points.rows), 3)), *(view[:, points.rows] for view in found)])
    detections[~np.isfinite(detections).all(axis=-1)] = 0.0
    return _Known(
        points,
        Detected(
            frozen(detections),
            frozen(np.cumsum([0, *(len(view) for view in found)]), np.int64),
            frozen(np.where(alone, np.arange(len(points.rows)), partners), np.int64),
            frozen(np.where(alone, -1, groups), np.int64),
        ),
    )


@component
class KeypointEvidence(KeypointFiles, Evidence):
    """Distances of points of the body from a detector's keypoints.

    Beside other kinds of evidence its weights are 1: distances then differ by a pixel or so for an arm in the wrong
    place, and equations move limbs that nothing else holds.
    """

    noise_m: float = pydantic.Field(default=0.03, gt=0)
    """Standard deviation of a keypoint from the point it means, metres: a detector and a body have different joints.
    Those of BlazePose on eight recordings are 0.023 to 0.037 m off in the median, in images."""

    outlier_m: float = pydantic.Field(default=0.15, gt=0)
    """Distance at which a keypoint is wrong, metres: it loses half at half of it. Of BlazePose's keypoints 1 to 13 %
    are farther off."""

    def check(self, scene: Scene) -> None:
        """Opens the files and checks that they mean points of each body; see `tracker.evidence.Evidence.check`."""
        try:
            views = self.checked(scene.rig)
            fitting = fitting_layout(self, scene.rig, scene.persons[0].body)
        except SequenceError as error:
            raise ConfigError(str(error)) from error
        if fitting:
            raise ConfigError(
                f"{self.path}: keypoints were read as {views.order.taken_for}, and limbs have the lengths of the body "
                f'as {fitting}: set layout = "{fitting}", or layout = "{views.order.layout}" if they are'
            )
        for body in (person.body for person in scene.persons):
            if not len(meant(views.names, body).rows):
                raise ConfigError(
                    f'{self.path}: no keypoint means a point of model "{body.name}"; keypoints: '
                    f"{', '.join(views.names)}; landmarks: {', '.join(body.landmark_names)}; "
                    "[keypoints] of a model file says what other names mean"
                )

    def told(self, known: Sequence[object | None]) -> str:
        """Folders of the keypoints."""
        return f"keypoints in {self.path}"

    def observe(self, sight: Sight, expected: Contours | None, memory: Memory = None) -> ObservedKeypoints:
        """Names the frame; see `tracker.evidence.Evidence.observe`."""
        seen = tuple(image is not None for image in sight.frame.images)
        return ObservedKeypoints(replace(sight.frame, images=(None,) * len(seen), masks=()), seen)

    def distances(self, asked: Comparison, poses: Array) -> Array:
        """(B,) mean loss of the keypoints, over those of a view and the views that have some, px; see `Matches`."""
        return self._averaged(self._per_view(self._matched(asked, poses)), asked.scene.rig)

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """Moves points of the body to their keypoints, all views in one system.

        It ignores the gate: a keypoint names its point, however far it is.
        """
        body, known = asked.body, asked.observed.about(asked, self).meant
        matched = self._matched(asked, q[None])
        views, rows = np.nonzero(matched.weights[0] > 0)
        if not len(views):
            return Equations.nothing(body.dof)
        points = body.points_in_world(q, known.points, known.ends)
        motion = body.point_jacobian(q, points, known.ends)
        slopes = np.stack([camera.project_jacobian(points) for camera in asked.scene.rig.cameras])
        sizes, residual = matched.px_per_m[0, views, rows], matched.gaps[0, views, rows]
        robust = (1 + (np.linalg.norm(residual, axis=1) / (self._reach_m * sizes)) ** 2) ** -2
        weights = matched.weights[0, views, rows] * robust / (self.noise_m * sizes) ** 2
        jacobian = slopes[views, rows] @ motion[rows]
        return Equations.of(residual.ravel(), jacobian.reshape(-1, body.dof), np.repeat(weights, 2))

    def account(self, asked: Comparison, q: Array) -> Account:
        """A keypoint counts as some contour, explained if most views have it at the pose's point.

        A keypoint elsewhere in one view alone is a detector's mistake: of right poses every fourth to tenth keypoint is
        more than 6 cm off in an image.
        """
        body, known = asked.body, asked.observed.about(asked, self).meant
        matched = self._matched(asked, q[None])
        weights, losses = matched.weights[0], matched.losses[0]
        present = (weights > 0) & (losses.mean(axis=1, keepdims=True) < _SOMEBODY_ELSE)
        near = present & (losses < _NEAR)
        agreed = 2 * near.sum(axis=0) >= present.sum(axis=0)
        explained = np.where(agreed, present.sum(axis=0), near.sum(axis=0))
        distances = losses * self._reach_m * matched.px_per_m[0] * present
        share = np.array([_share_of_parts(body, end) for end in known.ends]).reshape(-1, len(body.parts))
        visible, found, total = (values @ share for values in (present.sum(axis=0), explained, distances.sum(axis=0)))
        per_view = self._per_view(matched)
        distance_px = float(self._averaged(per_view, asked.scene.rig)[0])
        per_part = total / np.where(visible > 0, visible, np.nan)
        lengths = _WORTH_PX * visible, _WORTH_PX * found, np.zeros(len(body.parts))
        return Account(distance_px, per_view[0], per_part, *lengths)

    def pictures(self, asked: Comparison, sight: Sight, view: int) -> tuple[EvidencePicture, ...]:
        """Keypoints of the detection that fits the pose best, each with a line to its point of the body; red if far."""
        q, image = asked.scene.persons[asked.person].q, sight.frame.images[view]
        matched, known = self._matched(asked, q[None]), asked.observed.about(asked, self).meant
        there = np.flatnonzero(matched.weights[0, view] > 0)
        if image is None or not len(there):
            return (EvidencePicture("keypoints: none in this view", None),)
        points = asked.body.points_in_world(q, known.points, known.ends)[there]
        carried, far = asked.scene.rig.cameras[view].project(points), matched.losses[0, view, there] >= _NEAR
        picture = gaps_picture(image, carried - matched.gaps[0, view, there], carried, far)
        return (EvidencePicture("keypoints, and their points of the body", picture),)

    @property
    def _reach_m(self) -> float:
        """Distance at which a keypoint loses half."""
        return 0.5 * self.outlier_m

    def _per_view(self, matched: Matches) -> Array:
        """(B, V) weighted mean loss of a view's keypoints as a distance, px; NaN for a view without any."""
        total = matched.weights.sum(axis=2)
        distances = self._reach_m * matched.px_per_m * matched.losses
        summed = (matched.weights * distances).sum(axis=2)
        per_view: Array = summed / np.where(total > 0, total, np.nan)
        return per_view

    def _averaged(self, per_view: Array, rig: Rig) -> Array:
        """(B,) mean over the views; without any view that of outliers 4 m before the first camera."""
        return over_views(per_view, self._reach_m * float(rig.cameras[0].matrix[0, 0]) / 4)

    def _matched(self, asked: Comparison, poses: Array) -> Matches:
        """In each view the detection that fits each pose best, with the sides of limbs as they fit best."""
        known: _Known = asked.observed.about(asked, self)
        points = asked.body.points_in_world(poses, known.meant.points, known.meant.ends)
        rig, shape = asked.scene.rig, (len(poses), len(asked.scene.rig), len(known.meant.rows))
        matches = Matches(np.zeros((*shape, 2)), np.zeros(shape), np.zeros(shape), np.zeros(shape))
        reach = self._reach_m, _EXCHANGE_COSTS
        match_keypoints(np.ascontiguousarray(points), rig.packed, known.detected, known.n_limbs, reach, matches)
        return matches


def _share_of_parts(body: BodyModel, end: int) -> Array:
    """(P,) share of a point for each part: those that its own parameter moves, or all that it hangs on."""
    own = body.part_parameters == end
    if not own.any():
        own = body.moves[end, body.part_parameters] if end >= 0 else np.ones(len(body.parts), dtype=np.bool_)
    share: Array = own / max(int(own.sum()), 1)
    return share
