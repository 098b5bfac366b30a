"""How far skin and cloth slide over the bones of a tracked body: points on its surface beside their segments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.body.surface import nearest_parts
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.errors import SequenceError
from tracker.foundation.geometry.superquadrics import signed_distance
from tracker.tracking.estimate import Estimate

_LEAST_LEAD_M = 0.01
"""A point this much nearer to its part than to the next one is that part's; between two, nobody knows whose it is."""

_FARTHEST_M = 0.06
"""A point farther from the body is no skin or cloth of it."""

_LEAST_POINTS = 10
"""Points of a segment from which something is told of it."""


@dataclass(frozen=True)
class Slide:
    """Of a segment, from the frame of reference to another one."""

    segment: str
    n_points: int
    slide_m: float
    """How far points have moved along the surface, beside the bone, median."""

    most_m: float
    """What 95 % of them do not exceed."""

    lift_m: float
    """How far they have moved off the bone, median; negative towards it."""

    sigma_m: float
    """Standard deviation of a slide by what is not known of the two poses; NaN where a method tells none."""


@dataclass(frozen=True)
class OnBones:
    """N points on the parts of a body in the frame of reference."""

    body: BodyModel
    part: Integers
    """(N,) numbers of the parts; -1 for points that are nobody's."""

    place: Array
    """(N, 3) in the part's frame, metres."""

    normal: Array
    """(N, 3) outwards, in the part's frame."""

    begun: Estimate


def on_bones(body: BodyModel, begun: Estimate, positions: Array) -> OnBones:
    """The points of a frame on the parts of a body.

    Args:
        body: the person's.
        begun: its pose in the frame of reference.
        positions: (N, 3) metres; NaN where a point is not seen.

    Raises:
        SequenceError: the points are not on this body.
    """
    seen = np.flatnonzero(np.isfinite(positions[:, 0]))
    placed, part = body.world_from_part(begun.q), np.full(len(positions), -1)
    place, normal = np.zeros((len(positions), 3)), np.zeros((len(positions), 3))
    if not len(seen):
        raise SequenceError("no point is seen in the frame of reference")
    found, distance, lead = nearest_parts(positions[seen], placed, body.shapes)
    if np.median(np.abs(distance)) > _FARTHEST_M:
        raise SequenceError(
            f"half of the points are more than {1000 * float(np.median(np.abs(distance))):.0f} mm from the body: "
            "expected points and poses of one recording, in the world of one calibration"
        )
    sure = (np.abs(distance) < _FARTHEST_M) & (lead > _LEAST_LEAD_M)
    part[seen[sure]] = found[sure]
    for p, shape in enumerate(body.shapes):
        own = np.flatnonzero(part == p)
        place[own] = (positions[own] - placed[p, :3, 3]) @ placed[p, :3, :3]
        normal[own] = signed_distance(shape, place[own])[1]
    return OnBones(body, part, place, normal, begun)


def slides(points: OnBones, now: Estimate, positions: Array) -> tuple[Slide, ...]:
    """How far the points of each segment have slid since the frame of reference.

    Args:
        points: where they were.
        now: the pose of the frame.
        positions: (N, 3) of the points in it, metres; NaN where a point is not seen.
    """
    body, found = points.body, []
    placed = body.world_from_part(now.q)[points.part]
    local = np.einsum("nji,nj->ni", placed[:, :3, :3], positions - placed[:, :3, 3])
    moved = local - points.place
    lift = (moved * points.normal).sum(axis=1)
    along = moved - lift[:, None] * points.normal
    seen: Mask = (points.part >= 0) & np.isfinite(positions[:, 0])
    segments = np.where(seen, body.segments_of_parts[points.part], -1)
    for k, segment in enumerate(body.segments):
        own = np.flatnonzero(segments == k)
        if len(own) >= _LEAST_POINTS:
            length = np.linalg.norm(along[own], axis=1)
            most, middle = float(np.percentile(length, 95)), float(np.median(lift[own]))
            sigma = _pose_sigma(points, (points.begun, now), own)
            found.append(Slide(segment.name, len(own), float(np.median(length)), most, middle, sigma))
    return tuple(found)


def _pose_sigma(points: OnBones, estimates: Sequence[Estimate], own: Integers) -> float:
    """Standard deviation of a point's place along the surface by the poses, root of the mean over points and axes."""
    body, total = points.body, 0.0
    for one in estimates:
        placed = body.world_from_part(one.q)[points.part[own]]
        world = np.einsum("nij,nj->ni", placed[:, :3, :3], points.place[own]) + placed[:, :3, 3]
        normal = np.einsum("nij,nj->ni", placed[:, :3, :3], points.normal[own])
        jacobian = body.point_jacobian(one.q, world, body.part_parameters[points.part[own]])
        across = jacobian - normal[:, :, None] * np.einsum("ni,nij->nj", normal, jacobian)[:, None]
        total += float(np.einsum("nij,jk,nik->n", across, one.covariance, across).mean())
    return float(np.sqrt(total / 2)) if np.isfinite(total) else np.nan
