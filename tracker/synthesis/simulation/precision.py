"""How well a pose is to be measured from contours: the information of each view, and what subsets of views leave."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import comb

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.contours import PX_PER_OBSERVATION
from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array
from tracker.synthesis import Synthesis

PRIOR_DEG, PRIOR_M = 15.0, 0.15
"""Standard deviations of angles and places before the images are looked at: the defaults of `estimation.twist_icp`."""

_MOST_SUBSETS = 300
"""Subsets of one size that are looked through; of more views, the least useful are left out one by one."""


def view_information(scene: Scene, poses: Array, synthesis: Synthesis, edge_px: float) -> Array:
    """Information that each view gives of one person's pose.

    The contour of the visible parts is taken to be found with an error along its normal that is independent every
    `PX_PER_OBSERVATION` px, as the tracking takes it (D'Apuzzo's normal equations, as in `tracking.estimation`).

    Args:
        scene: the person alone, and the rig.
        poses: (B, dof) rad and m.
        synthesis: traces the contours.
        edge_px: standard deviation of an edge position, px.

    Returns:
        (B, V, dof, dof) in 1/rad^2 and 1/m^2.
    """
    body = scene.persons[0].body
    traced = synthesis.contours(scene, 0, poses)
    found = np.zeros((len(poses), len(scene.rig), body.dof, body.dof))
    for b, q in enumerate(poses):
        for v, camera in enumerate(scene.rig.cameras):
            n = int(traced.counts[b, v])
            points = traced.points[b, v, :n].astype(np.float64)
            samples = traced.positions[b, v, :n].astype(np.float64)
            motion = body.point_jacobian(q, points, body.part_parameters[traced.parts[b, v, :n]])
            across = np.einsum("ni,nij->nj", samples[:, 2:4], camera.project_jacobian(points))
            rows = np.einsum("nj,njd->nd", across, motion)
            found[b, v] = (rows * samples[:, 4:5]).T @ rows / (PX_PER_OBSERVATION * edge_px**2)
    return found


def covariances(body: BodyModel, information: Array, views: Sequence[int]) -> Array:
    """Covariances (B, dof, dof) of poses seen by some views.

    What no view shows is held by the prior that the refinement has, 15 degrees and 0.15 m.

    Args:
        body: the person.
        information: (B, V, dof, dof) of `view_information`.
        views: numbers of the views.
    """
    spread = np.where(body.rotates, np.radians(PRIOR_DEG), PRIOR_M)
    total = information[:, list(views)].sum(axis=1) + np.diag(1 / spread**2)
    covariance: Array = np.linalg.inv(total)
    return covariance


def joint_sigmas(body: BodyModel, poses: Array, covariance: Array) -> Array:
    """Standard deviations (B, L) of all landmarks, metres: the root of the mean squared distance from the truth."""
    ends = np.array([mark.parameter for mark in body.landmarks])
    sigmas = np.zeros((len(poses), len(ends)))
    for b, q in enumerate(poses):
        motion = body.point_jacobian(q, body.landmarks_in_world(q), ends)
        sigmas[b] = np.sqrt(np.einsum("lid,de,lie->l", motion, covariance[b], motion))
    return sigmas


def best_views(body: BodyModel, poses: Array, information: Array) -> dict[int, tuple[int, ...]]:
    """For every number of views those that together measure the joints best; from 2 to all of them.

    Where there are too many subsets of a size to look through, the next larger one is left without its least useful
    view.

    Args:
        body: the person.
        poses: (B, dof).
        information: (B, V, dof, dof) of `view_information`.
    """
    n_views = information.shape[1]
    found: dict[int, tuple[int, ...]] = {n_views: tuple(range(n_views))}

    def error(views: Sequence[int]) -> float:
        sigmas = joint_sigmas(body, poses, covariances(body, information, views))
        return float(np.sqrt(np.mean(sigmas**2)))

    for n in range(n_views - 1, 1, -1):
        if comb(n_views, n) > _MOST_SUBSETS:
            subsets = [tuple(v for v in found[n + 1] if v != left_out) for left_out in found[n + 1]]
        else:
            subsets = list(combinations(range(n_views), n))
        found[n] = min(subsets, key=error)
    return dict(sorted(found.items()))
