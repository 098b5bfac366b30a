"""Where a person is among surface points, and in which posture: many starts, each moved to the points."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from tracker.acquisition._surface_points import outside
from tracker.acquisition.clouds import Cloud, cloud_of
from tracker.bodies.body import BodyModel
from tracker.bodies.body.surface import surface_of
from tracker.foundation.arrays import Array

_HEADINGS_DEG = np.arange(0, 360, 45)
"""Directions that the person may face: those between are within reach of the steps."""

_ARMS_DEG, _LEGS_DEG = (8.0, 40.0, 85.0), 6.0
"""Abductions that are tried: hanging arms, A-pose, T-pose; feet a little apart."""

_SPACING_M = 0.05
"""Of the points that starts are moved to: 700 of a whole body."""

_GATES_M = np.geomspace(0.4, 0.06, 14)
"""Of the steps from a start: half of the first is how far an arm may be from where it is looked for."""

_MOST_M = 0.1
"""Distance from which a point is simply wrong."""

_PRIOR_DEG, _PRIOR_M, _NOISE_M = 40.0, 1.0, 0.03
"""Standard deviations of angles and shifts about a start, and of points while the shape is not yet right."""

_OTHER_DEG = 60.0
"""A heading farther off than this is another one."""

_POINTS_TO_MODEL = 2.0
"""What a point off the model counts more than a place of the model without a point: points may be partial."""


@dataclass(frozen=True)
class Posed:
    """A posture among points."""

    q: Array
    """(dof,) rad and m."""

    distance_m: float
    """Mean of the distances from points to model and from model to points, clamped at 0.1 m."""

    heading_deg: float
    """Direction faced, from x towards y, degrees."""


def standing_among(body: BodyModel, cloud: Cloud, heading_deg: float | None = None) -> tuple[Posed, ...]:
    """The posture of all starts that fits the points best, and the best one that faces elsewhere.

    Args:
        body: the body in about the right size.
        cloud: points of most of one person.
        heading_deg: direction faced, within 60 degrees; None for any.
    """
    coarse = cloud_of(cloud.points, cloud.sigmas, _SPACING_M)
    surface, tree = surface_of(body, 7, 10).points, cKDTree(coarse.points)
    found = []
    for q in _starts(body, coarse, surface):
        moved = moved_to(body, q, coarse, _GATES_M)
        faced = float(np.degrees(moved[body.root.turn])) % 360
        if heading_deg is None or _apart_deg(faced, heading_deg) <= _OTHER_DEG:
            found.append(Posed(moved, _misfit(body, moved, coarse, tree), faced))
    if not found:
        return ()
    best = min(found, key=lambda one: one.distance_m)
    others = [one for one in found if _apart_deg(one.heading_deg, best.heading_deg) > _OTHER_DEG]
    return best, *sorted(others, key=lambda one: one.distance_m)[:1]


def _apart_deg(one: float, other: float) -> float:
    return abs((one - other + 180) % 360 - 180)


def moved_to(body: BodyModel, start: Array, cloud: Cloud, gates_m: Array) -> Array:
    """A pose (dof,) moved by Gauss-Newton steps until the body's outside lies on the points.

    Args:
        body: the body.
        start: (dof,) rad and m.
        cloud: the points.
        gates_m: one a step: a point half as far off has a quarter of its weight, metres.
    """
    q = start
    prior = np.where(body.rotates, np.radians(_PRIOR_DEG), _PRIOR_M) ** -2.0
    for gate_m in gates_m:
        part, feet, normals = outside(body.world_from_part(q), body.shapes, cloud.points)
        gap = ((feet - cloud.points) * normals).sum(axis=1)
        weights = (1 + (gap / (0.5 * gate_m)) ** 2) ** -2.0
        weights *= np.abs((normals * cloud.normals).sum(axis=1)) > 0.5
        jacobian = np.einsum("ni,nij->nj", normals, body.point_jacobian(q, feet, body.part_parameters[part]))
        weighted = weights[:, None] * jacobian / _NOISE_M**2
        matrix, vector = jacobian.T @ weighted + np.diag(prior), weighted.T @ gap + prior * (q - start)
        q = body.clamped(q - np.linalg.solve(matrix, vector))
    return q


def _starts(body: BodyModel, cloud: Cloud, surface: Array) -> Iterator[Array]:
    """Poses (dof,) whose middle is that of the points."""
    root, middle = body.root, _middle(cloud.points)
    arms = [k for name in ("arm_abduction",) for k in _columns(body, name)]
    for heading_deg, arms_deg in product(_HEADINGS_DEG, _ARMS_DEG if arms else (0.0,)):
        q = body.rest()
        q[arms] = np.radians(arms_deg)
        q[_columns(body, "leg_abduction")] = np.radians(_LEGS_DEG)
        q[root.turn] = np.radians(heading_deg)
        q[root.shifts] += middle - _middle(surface)
        yield body.clamped(q)


def _columns(body: BodyModel, name: str) -> list[int]:
    """Columns of a parameter on both sides; none where the body has no such."""
    return [body.names.index(own) for own in body.mirror.meant(name, body.names)]


def _middle(points: Array) -> Array:
    """Of the box around all but a few points, (3,) metres."""
    low, high = np.percentile(points, [1, 99], axis=0)
    middle: Array = (low + high) / 2
    return middle


def _misfit(body: BodyModel, q: Array, cloud: Cloud, tree: cKDTree) -> float:
    _, feet, _ = outside(body.world_from_part(q), body.shapes, cloud.points)
    there = np.linalg.norm(feet - cloud.points, axis=1)
    back = np.asarray(tree.query(_outer_grid(body, q))[0])
    one, other = (float(np.minimum(gaps, _MOST_M).mean()) for gaps in (there, back))
    return (_POINTS_TO_MODEL * one + other) / (_POINTS_TO_MODEL + 1)


def _outer_grid(body: BodyModel, q: Array) -> Array:
    """Places (N, 3) of all parts' surfaces that lie in no other part, metres."""
    placed, points = body.world_from_part(q), []
    eta, omega = np.linspace(-1.3, 1.3, 6)[:, None], np.linspace(-np.pi, np.pi, 9)[:-1]
    for part, own in zip(body.parts, placed, strict=True):
        local, _ = part.shape.surface(eta, omega)
        points.append(local.reshape(-1, 3) @ own[:3, :3].T + own[:3, 3])
    every = np.concatenate(points)
    carriers = np.repeat(np.arange(len(points)), [len(one) for one in points])
    grid: Array = every[outside(placed, body.shapes, every)[0] == carriers]
    return grid
