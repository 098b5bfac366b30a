"""Evidence of followed points: texture on clothes and skin moves with the part that carries it.

Contours of round limbs do not show their turn about their long axes; points on them do. A point is attached
once, where it is first seen on the fitted surface, and stays there: attached anew in every frame it would say nothing.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import pydantic

from tracker.bodies.body.surface import nearest_parts
from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.cameras.rig import Rig
from tracker.evidence import GUESSED, Evidence, EvidencePicture, Memory
from tracker.evidence._attachment import Attachments, Followed, met_by_rays, open_followed, ray_covariances
from tracker.evidence._held import Held, held_in, turning
from tracker.evidence._shares import gaps_picture, over_views
from tracker.evidence.measures.account import Account
from tracker.evidence.measures.correspondences import Equations
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.configuration.components import PathPattern, component
from tracker.images.sight import Sight

log = logging.getLogger("tracker")

_WORTH_PX = 20.0
"""Contour that an independent point counts as in sums of lengths, px: as a keypoint does."""

_MOST_TIMES = 2
"""Number of attachments: a dropped point may be attached once more; one that goes wrong twice lies on nothing rigid."""


@dataclass(frozen=True)
class ObservedPoints:
    """Points of a frame, and their attachments."""

    frame: int
    seen: tuple[bool, ...]
    """Views that are not missing."""

    attached: Attachments | None
    """None if nothing is attached yet, or the expected pose is only a guess."""

    _held: dict[int, Held] = field(default_factory=dict, repr=False, compare=False)

    def held(self, evidence: PointEvidence, asked: Comparison) -> Held:
        """The attached points of a person that the frame shows."""
        if asked.person not in self._held:
            own = asked.own
            attached = self.attached or Attachments.none()
            mine = attached.chosen((attached.part >= own.start) & (attached.part < own.stop))
            tables = evidence.tables(asked.scene.rig)
            self._held[asked.person] = held_in(mine, tables, self.frame, self.seen, own.start)
        return self._held[asked.person]


@component
class PointEvidence(Evidence):
    """Points that `bodytrack follow` has followed on the person, attached to the parts that carry them.

    It is robust against points that were attached wrongly or have slipped: they have little weight, and points that
    disagree in several consecutive frames are dropped and logged.
    """

    path: PathPattern
    """`trajectories.csv` of `bodytrack follow`, or its result folder: points in space, or, with `{view}` in the path,
    points followed in the images of single views (2-D mode). Frames are numbered as in the recording."""

    downscale: int | None = pydantic.Field(default=None, ge=1, le=16)
    """Size of the images in which points were followed, over that of the tracked images; default: as recorded."""

    directions: Literal["around", "all"] = "around"
    """Use of a point in a refinement: its turn about the long axis of its part, if the part can turn so by itself,
    because contours do not show that; or all of its motion."""

    facing: float = pydantic.Field(default=0.5, gt=0, lt=1)
    """Least cosine between surface normal and camera for attaching points: patches at contours show the background."""

    near_m: float = pydantic.Field(default=0.04, gt=0)
    """Largest distance of points in space from the surface to which they are attached, metres."""

    surface_m: float = pydantic.Field(default=0.015, gt=0)
    """Standard deviation of the fitted surface from the true one, metres: the depth of a point of an image."""

    slide_m: float = pydantic.Field(default=0.008, gt=0)
    """Standard deviation of a point against the rigid part that carries it, metres: clothes slide, skin stretches."""

    observations: float = pydantic.Field(default=8.0, gt=0)
    """Most independent observations of the points of a part in a view: clothes, and errors of the pose at which they
    were attached, move all of them."""

    outlier_sigmas: float = pydantic.Field(default=4.0, gt=0)
    """A point farther than this from its position by the part disagrees, standard deviations."""

    patience: int = pydantic.Field(default=3, ge=1)
    """Consecutive frames in which a point may disagree before it is dropped."""

    def tables(self, rig: Rig) -> tuple[Followed, ...]:
        """The followed points, read once."""
        return open_followed(self.path, rig.names, tuple(self.downscale or one.downscale for one in rig.cameras))

    def observe(self, sight: Sight, expected: Contours | None, memory: Memory = None) -> ObservedPoints:
        """Names the frame, and its attachments; see `tracker.evidence.Evidence.observe`."""
        seen = tuple(image is not None for image in sight.frame.images)
        return ObservedPoints(sight.frame.index, seen, None if memory is GUESSED else memory)

    def distances(self, asked: Comparison, poses: Array) -> Array:
        """(B,) distance of the points from their positions by the parts, averaged over points and views, px."""
        return over_views(self._per_view(asked, poses), 0.0)

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """Turns the parts to their points, robustly weighted (Geman & McClure)."""
        held = asked.observed.held(self, asked)
        if not len(held.part):
            return Equations.nothing(asked.body.dof)
        found = held.residuals(asked.body, q, asked.scene.rig, self.slide_m)
        turned: Mask = np.ones(len(held.part), dtype=np.bool_)
        if self.directions == "around":
            found = found.along(held.turns(asked.body, q, asked.scene.rig))
            turned = turning(asked.body)[held.part]
        variance = np.maximum(found.variance, 1e-6)
        squares = (found.residual**2).sum(axis=1)
        # a point off by the gate, or by three standard deviations, has a quarter of its weight
        robust = (1 + squares / ((0.5 * gate_px) ** 2 + 9 * variance)) ** -2
        weights = robust * held.shares(self.observations) * (found.seen & turned & ~held.suspect) / variance
        n = found.residual.shape[1]
        jacobian = found.jacobian.reshape(-1, asked.body.dof)
        return Equations.of(found.residual.ravel(), jacobian, np.repeat(weights, n))

    def account(self, asked: Comparison, q: Array) -> Account:
        """A point is explained within the standard deviations of an outlier; lengths are 20 px an observation."""
        body, held = asked.body, asked.observed.held(self, asked)
        n_parts, per_view = len(body.parts), self._per_view(asked, q[None])
        gaps = held.gaps_px(body, q[None], asked.scene.rig, self._most_m)[0]
        near = ~held.residuals(body, q, asked.scene.rig, self.slide_m).beyond(self.outlier_sigmas)
        lengths = _WORTH_PX * held.shares(self.observations) * np.array([np.ones_like(gaps), near, gaps])
        parts = (np.bincount(held.part, values, n_parts) for values in lengths)
        visible, explained, total = np.array(list(parts), dtype=np.float64)
        distance_px = float(over_views(per_view, 0.0)[0])
        per_part = total / np.where(visible > 0, visible, np.nan)
        return Account(distance_px, per_view[0], per_part, visible, explained, np.zeros(n_parts))

    def learned(self, memory: Memory, sight: Sight, scene: Scene, fitted: Contours, trusted: Mask) -> Attachments:
        """The attachments after a frame: wrong points are dropped, new ones attached to trusted parts."""
        attached: Attachments = Attachments.none() if memory is None or memory is GUESSED else memory
        seen = tuple(image is not None for image in sight.frame.images)
        attached = self._after(attached, sight.frame.index, seen, scene, trusted)
        return attached.joined(self._fresh(attached, sight.frame.index, seen, scene, trusted))

    def pictures(self, asked: Comparison, sight: Sight, view: int) -> tuple[EvidencePicture, ...]:
        """Followed points of the frame, with a line to their positions by the parts; red if too far."""
        image, held = sight.frame.images[view], asked.observed.held(self, asked)
        here = (held.view == view) | (held.view < 0)
        if image is None or not here.any():
            return (EvidencePicture("points: this view shows no attached point", None),)
        q, rig = asked.scene.persons[asked.person].q, asked.scene.rig
        wrong = held.residuals(asked.body, q, rig, self.slide_m).beyond(self.outlier_sigmas)
        carried = rig.cameras[view].project(held.world(asked.body, q[None])[0])
        shown = np.where(held.view[:, None] < 0, rig.cameras[view].project(held.seen_at), held.seen_at[:, :2])
        picture = gaps_picture(image, shown[here], carried[here], wrong[here])
        return (EvidencePicture("followed points, and their positions by the parts", picture),)

    @property
    def _most_m(self) -> float:
        """Distance from which on a point is wrong, metres."""
        return self.outlier_sigmas * float(np.hypot(self.slide_m, self.surface_m))

    def _per_view(self, asked: Comparison, poses: Array) -> Array:
        """(B, V) mean distance, px; NaN for a view without attached points. Points in space are of every view."""
        held = asked.observed.held(self, asked)
        gaps = held.gaps_px(asked.body, poses, asked.scene.rig, self._most_m)
        per_view = np.full((len(poses), len(asked.scene.rig)), np.nan)
        for v, there in enumerate(asked.observed.seen):
            own = (held.view == v) | (held.view < 0)
            if there and own.any():
                per_view[:, v] = gaps[:, own].mean(axis=1)
        return per_view

    def _after(
        self, attached: Attachments, frame: int, seen: tuple[bool, ...], scene: Scene, trusted: Mask
    ) -> Attachments:
        """The attachments judged at the poses of a frame."""
        shown, off = (np.zeros(len(attached.part), dtype=np.bool_) for _ in range(2))
        tables = self.tables(scene.rig)
        for k, person in enumerate(scene.persons):
            first = scene.first_part(k)
            own = (attached.part >= first) & (attached.part < first + len(person.body.parts))
            rows = np.flatnonzero(own & _anywhere(trusted)[attached.part])
            held = held_in(attached.chosen(rows), tables, frame, seen, first)
            found = held.residuals(person.body, person.q, scene.rig, self.slide_m)
            shown[rows[held.rows]] = True
            off[rows[held.rows]] = found.beyond(self.outlier_sigmas)
        judged, dropped = attached.judged(shown, off, self.patience)
        if dropped.any():
            told = np.bincount(attached.part[dropped], minlength=len(scene.shapes))
            names = [part.name for person in scene.persons for part in person.body.parts]
            parts = ", ".join(f"{names[p]} {told[p]}" for p in np.flatnonzero(told))
            n_left = int((judged.part >= 0).sum())
            log.info("frame %d: points that left their parts are dropped: %s; %d are attached", frame, parts, n_left)
        return judged

    def _fresh(
        self, attached: Attachments, frame: int, seen: tuple[bool, ...], scene: Scene, trusted: Mask
    ) -> Attachments:
        """Points of the frame without a part, on the parts at their places."""
        found = Attachments.none()
        for k, table in enumerate(self.tables(scene.rig)):
            if table.view >= 0 and not seen[table.view]:
                continue
            points, places, noise = table.at(frame)
            times = np.bincount(attached.point[attached.table == k], minlength=len(table.trajectories.ids))
            carried = attached.point[(attached.table == k) & (attached.part >= 0)]
            new = ~np.isin(points, carried) & (times[points] < _MOST_TIMES)
            if new.any():
                rows = points[new], places[new], noise[new]
                one = self._by_rays(scene, table.view, *rows) if table.view >= 0 else self._in_space(scene, *rows)
                known = trusted[table.view] if table.view >= 0 else _anywhere(trusted)
                one = one.chosen((one.part >= 0) & known[one.part])
                found = found.joined(replace(one, table=np.full(len(one.part), k)))
        return found

    def _by_rays(self, scene: Scene, view: int, points: Integers, pixels: Array, noise: Array) -> Attachments:
        """Points of an image, where their rays meet the surface."""
        camera, placed = scene.rig.cameras[view], scene.world_from_parts()[0]
        rays = camera.rays(pixels)
        met = met_by_rays(camera.centre, rays, placed, scene.shapes)
        part = np.where(met.facing >= self.facing, met.part, -1)
        rotations = placed[part, :3, :3]
        world = np.einsum("nij,nj->ni", rotations, met.point) + placed[part, :3, 3]
        depth = np.maximum(camera.in_camera(world)[:, 2], 0.1)
        lateral = np.sqrt(np.trace(noise, axis1=1, axis2=2) / 2) * depth / camera.matrix[0, 0]
        along = np.einsum("nji,nj->ni", rotations, rays)
        covariance = ray_covariances(along, met.facing, lateral, self.surface_m)
        return Attachments.of(points, part, met.point, covariance)

    def _in_space(self, scene: Scene, points: Integers, places: Array, noise: Array) -> Attachments:
        """Points in space, on the nearest part; none if two parts are equally near."""
        placed = scene.world_from_parts()[0]
        part, distance, lead = nearest_parts(places, placed, scene.shapes)
        part = np.where((np.abs(distance) <= self.near_m) & (lead > self.slide_m), part, -1)
        rotations = placed[part, :3, :3]
        local = np.einsum("nji,nj->ni", rotations, places - placed[part, :3, 3])
        covariance = rotations.transpose(0, 2, 1) @ noise @ rotations
        return Attachments.of(points, part, local, covariance)


def _anywhere(trusted: Mask) -> Mask:
    """(P,) parts that are trusted in some view (V, P)."""
    found: Mask = np.any(trusted, axis=0)
    return found
