"""Uncertainty of a fitted body: the few ways in which it may differ that move joints or angles, kept with it.

A pose is found as if the body were known. If the body is wrong, the pose with the same contours is wrong by a constant
that no frame shows. Of `h(s, q)`, contours by shape s and pose q, with information ``H``, ``dq/ds = -(H_qq + P)^-1
H_qs`` (implicit function theorem), and shape and its unknowns are marginalized: ``Sigma_q + dq/ds Sigma_s dq/ds^T``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tracker.acquisition._anatomy import Anatomy
from tracker.acquisition._residuals import Bodies, across_normals, asks_of, part_slopes
from tracker.acquisition.shape_space import ShapeSpace, Variants
from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import BodyDescription
from tracker.bodies.body.entries import Variation
from tracker.bodies.contours import Contours
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Integers
from tracker.foundation.geometry.superquadrics import surface
from tracker.tracking.estimate import Estimate
from tracker.tracking.objective import Objective
from tracker.tracking.trajectory import Step

_LEFT_OUT = 0.005
"""Share of the variance of angles and joints that the ways left out may have: a twentieth of a sigma is not seen."""

_MOST = 32
"""Ways kept at most."""

_ANGLE, _LENGTH_M = np.radians(1.0), 0.01
"""As much as each other when ways are chosen, rad and metres."""

_STEP = 1e-3
"""Of differences, in standard deviations of a way."""

_EVERY = 3
"""Samples of a contour, some 2 px apart, that are looked at: their sums hardly change."""

_NOISE_PX, _HELD_DEG, _HELD_M = 1.0, 15.0, 0.15
"""Weight of the prior in a refinement, see `TwistIcpEstimation`."""


def variations_of(space: ShapeSpace, shape: Array, covariance: Array, poses: Sequence[Array]) -> tuple[Variation, ...]:
    """The ways in which a body may differ, most important first, by one standard deviation each.

    Args:
        space: what may differ at all.
        shape: (S,) of the body.
        covariance: (S, S) of the shape.
        poses: (dof,) each, in which angles and joints are to be told; without any, the rest pose.
    """
    factor = np.linalg.cholesky(covariance + 1e-12 * np.eye(len(covariance)))
    bodies = (space.body(shape), space.neighbours(shape), space.steps(shape))
    effects = np.concatenate([_effects(bodies, q) @ factor for q in poses or (space.general.rest(),)])
    _, sizes, ways = np.linalg.svd(effects, full_matrices=False)
    left = 1 - np.cumsum(sizes**2) / (sizes**2).sum()
    n_kept = min(int(np.argmax(left < _LEFT_OUT)) + 1, _MOST)
    changes = np.round(space.directions @ factor @ ways[:n_kept].T, 7)
    still = Anatomy.of(space.description).still()
    return tuple(_variation(still.plus(change)) for change in changes.T)


def of_people(space: ShapeSpace) -> tuple[Variation, ...]:
    """The ways in which persons differ from a model that could not be fitted to one of them."""
    return variations_of(space, np.zeros(len(space.names)), space.covariance, ())


def _effects(bodies: Bodies, q: Array) -> Array:
    """(dof + 3 L, S) how angles and joints change with the shape while the surfaces stay, in units to compare them."""
    body, _, steps = bodies
    points, parts, normals = _surfaces(body, q)
    weights = np.full(len(points), 1e6 / len(points))  # as firmly as some 300 pixels of contour, in a world of metres
    turned = _turned(bodies, q, (asks_of(body, q, points, parts, normals), parts, weights))
    moved = _moved(bodies, q, _by_pose(body, q), turned)
    scales = np.where(body.rotates, _ANGLE, _LENGTH_M)
    return np.concatenate([turned / scales[:, None], moved.reshape(-1, len(steps)) / _LENGTH_M])


def _surfaces(body: BodyModel, q: Array) -> tuple[Array, Integers, Array]:
    """Points (N, 3) all over the parts, their parts (N,), and their normals (N, 3) in the world."""
    eta, omega = np.linspace(-1.3, 1.3, 7)[:, None], np.linspace(-np.pi, np.pi, 13)[:-1]
    placed = body.world_from_part(q)
    found = [surface(shape, eta, omega) for shape in body.shapes]
    points = [one.reshape(-1, 3) @ at[:3, :3].T + at[:3, 3] for (one, _), at in zip(found, placed, strict=True)]
    normals = [one.reshape(-1, 3) @ at[:3, :3].T for (_, one), at in zip(found, placed, strict=True)]
    parts = np.repeat(np.arange(len(found), dtype=np.int64), len(points[0]))
    return np.concatenate(points), parts, np.concatenate(normals)


def _turned(bodies: Bodies, q: Array, rows: tuple[Array, Integers, Array]) -> Array:
    """(dof, S) dq/ds with contours as they are.

    Args:
        bodies: the body and its neighbours.
        q: (dof,) pose.
        rows: what points ask of their parts (N, 25), parts and weights (N,).
    """
    body, (asks, parts, weights) = bodies[0], rows
    slopes, n_ways = part_slopes(bodies, q), len(bodies[2])
    matrix = np.zeros((slopes.shape[-1], slopes.shape[-1]))
    for p in np.unique(parts):
        mine = parts == p
        matrix += slopes[p].T @ ((asks[mine] * weights[mine, None]).T @ asks[mine]) @ slopes[p]
    held = (_NOISE_PX / np.where(body.rotates, np.radians(_HELD_DEG), _HELD_M)) ** 2
    usual = 2 * Objective.rare_px * float(weights.sum()) / body.spreads**2
    return np.asarray(-np.linalg.solve(matrix[n_ways:, n_ways:] + np.diag(held + usual), matrix[n_ways:, :n_ways]))


def _by_pose(body: BodyModel, q: Array) -> Array:
    """(L, 3, dof) how the landmarks move in the world by the pose."""
    ends = np.array([mark.parameter for mark in body.landmarks], dtype=np.int64)
    return body.point_jacobian(q, body.landmarks_in_world(q), ends)


def _moved(bodies: Bodies, q: Array, by_pose: Array, turned: Array) -> Array:
    """(L, 3, S) how the landmarks move in the world, by the shape and by the pose (dof, S) that goes with it."""
    body, neighbours, steps = bodies
    by_shape = np.moveaxis(neighbours.placements(q)[1] - body.landmarks_in_world(q), 0, -1) / steps
    moved: Array = by_shape + by_pose @ turned
    return moved


def _variation(change: Anatomy) -> Variation:
    names = Variation.model_fields
    return Variation.model_validate({name: getattr(change, name).tolist() for name in names})


@dataclass(frozen=True)
class Unsure:
    """A body with the ways in which it may differ."""

    bodies: Bodies

    @classmethod
    def of(cls, description: BodyDescription) -> Unsure | None:
        """Variations of a model file; None if its body counts as exact."""
        if not description.variations:
            return None
        body, still = description.build(), Anatomy.of(description).still()
        changes = np.array([_packed(one, still) for one in description.variations])
        near = Variants.of(body, description, _STEP * changes)
        return cls((body, near, np.full(len(changes), _STEP)))

    def told(self, estimate: Estimate, rig: Rig, contours: Contours, first_part: int) -> Estimate:
        """An estimate with what is not known of the body in its covariance, and in the sigmas of its joints.

        Args:
            estimate: found as if the body were known.
            rig: the cameras.
            contours: of the scene with the estimate's pose.
            first_part: of the body among those of the scene.
        """
        body, q = self.bodies[0], estimate.q
        if estimate.lost or not np.isfinite(estimate.covariance).all():
            return estimate
        turned = _turned(self.bodies, q, _contour_rows(body, q, rig, contours, first_part))
        by_pose = _by_pose(body, q)
        found = by_pose @ estimate.covariance @ by_pose.transpose(0, 2, 1)
        variances = np.einsum("lii->l", found) + (_moved(self.bodies, q, by_pose, turned) ** 2).sum(axis=(1, 2))
        return replace(
            estimate,
            covariance=estimate.covariance + turned @ turned.T,
            joint_sigmas_m=np.sqrt(np.maximum(variances, 0.0)),
        )


def _packed(one: Variation, still: Anatomy) -> Array:
    """(n,) a change of the anatomy; what a body has come to carry since stays as it is."""
    own = {name: getattr(still, name).copy() for name in Variation.model_fields}
    for name, values in own.items():
        given = np.array(getattr(one, name)).reshape(-1, values.shape[-1])
        values[: len(given)] = given
    return replace(still, **own).packed()


def _contour_rows(
    body: BodyModel, q: Array, rig: Rig, contours: Contours, first_part: int
) -> tuple[Array, Integers, Array]:
    views, points, parts, normals, weights = [], [], [], [], []
    for v in range(len(rig)):
        seen = contours.of(v)
        own = np.flatnonzero((seen.parts >= first_part) & (seen.parts < first_part + len(body.parts)))[::_EVERY]
        own = own[seen.weights[own] > 0]
        views.append(np.full(len(own), v))
        points.append(seen.points[own].astype(np.float64))
        parts.append(seen.parts[own] - first_part)
        normals.append(seen.normals[own].astype(np.float64))
        weights.append(seen.weights[own].astype(np.float64) * _EVERY / _ALIKE_PX)
    at, whose = np.concatenate(points), np.concatenate(parts)
    across = across_normals(rig, at, np.concatenate(views), np.concatenate(normals))
    return asks_of(body, q, at, whose, across), whose, np.concatenate(weights)


_ALIKE_PX = 10.0
"""Contour that counts as one observation, px, against what holds a pose."""


def telling_bodies(
    steps: Iterable[Step], models: Mapping[str, BodyDescription], told: Iterable[int] = ()
) -> Iterator[Step]:
    """Steps whose estimates include the uncertainty of the bodies.

    Args:
        steps: estimates as if bodies were known.
        models: person -> model, with its variations.
        told: numbers of the frames that an interrupted run has told so.
    """
    unsure = {name: found for name, model in models.items() if (found := Unsure.of(model)) is not None}
    already = frozenset(told)
    for step in steps:
        if step.frame.index in already or not unsure:
            yield step
            continue
        estimates = list(step.estimates)
        for k, person in enumerate(step.scene.persons):
            if person.name in unsure:
                first = step.scene.first_part(k)
                estimates[k] = unsure[person.name].told(estimates[k], step.scene.rig, step.fitted, first)
        yield replace(step, estimates=tuple(estimates))
