"""What a faultless image analysis would find: observations made from contours themselves."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from tracker.bodies.body import BodyModel
from tracker.bodies.contours import Contours, ViewContours
from tracker.bodies.scene import Scene
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.arrays import Array, Mask
from tracker.images.sight import Observation, ViewObservation
from tracker.synthesis.cpu import CpuSynthesis
from tracker.tracking.objective import Objective

REACH_PX = 40.0
PLACES = {"a": (3.7, 3.7, 2.3), "b": (-3.6, 3.6, 2.3), "c": (-3.4, -3.9, 1.5), "d": (3.8, -3.5, 2.0)}


def four_views(size: tuple[int, int] = (360, 288)) -> Rig:
    """Cameras in the corners of a room that show a person about 150 px high in the smallest images."""
    middle, focal_px = np.array([0.0, 0.0, 1.0]), 425.0 * size[0] / 360
    return Rig(tuple(Camera.looking_at(name, size, focal_px, place, middle) for name, place in PLACES.items()))


def bent(body: BodyModel) -> Array:
    """A pose (dof,) of the 22-parameter body in which every parameter shows: the limbs bent and off the trunk."""
    degrees = {"arm_abduction": 40, "arm_elevation": 20, "arm_twist": 10, "arm_extension": 60} | {
        "leg_abduction": 15, "leg_elevation": 25, "leg_twist": 5, "leg_extension": 40
    }  # fmt: skip
    q = np.zeros(body.dof)
    for name, angle_deg in degrees.items():
        for side, factor in (("left", 1.0), ("right", 0.8)):
            q[body.index(f"{side}_{name}")] = np.radians(factor * angle_deg)
    q[:3] = 0.1, -0.05, 1.0
    q[body.index("torso_elevation")] = 0.1
    q[body.index("torso_twist")] = 0.4
    return q


def ideal(scene: Scene, noise_px: float = 0.0, seed: int = 0, step_px: float = 2.0) -> Observation:
    """The outer contours of a scene as edges, each point moved along its normal by Gaussian noise."""
    drawn = CpuSynthesis(step_px=step_px, n_eta=17, n_omega=32).contours(scene)
    return observed(drawn, scene.rig, noise_px, seed)


def observed(contours: Contours, rig: Rig, noise_px: float = 0.0, seed: int = 0) -> Observation:
    """The outer contours of the first pose as edges."""
    rng = np.random.default_rng(seed)
    views = (view_of(contours.of(v), camera.size, noise_px, rng) for v, camera in enumerate(rig.cameras))
    return Observation(tuple(views))


def view_of(
    contours: ViewContours, size: tuple[int, int], noise_px: float, rng: np.random.Generator, margin: int = 48
) -> ViewObservation:
    """Edge points of either contrast with an exact chamfer image of the region around them."""
    outer: Mask = ~contours.between
    n = int(outer.sum())
    shifts, signs = noise_px * rng.normal(size=(n, 1)), rng.choice([-1, 1], (n, 1))
    edges = (contours.pixels[outer] + shifts * contours.normals[outer]).astype(np.float32)
    low = np.maximum(np.floor(edges.min(axis=0)).astype(int) - margin, 0)
    high = np.minimum(np.ceil(edges.max(axis=0)).astype(int) + margin, np.array(size) - 1)
    columns, rows = np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(low, high, strict=True)))
    distance, _ = cKDTree(edges).query(np.stack([columns, rows], axis=-1), distance_upper_bound=REACH_PX)
    return ViewObservation(
        edges=edges,
        directions=(signs * contours.normals[outer]).astype(np.float32),
        segments=np.zeros(n, dtype=np.int64),
        accepted=np.ones(n, dtype=np.bool_),
        scene=np.arange(n),
        scene_weights=contours.weights[outer],
        origin=(int(low[0]), int(low[1])),
        distance=np.minimum(distance, REACH_PX).astype(np.float32),
        reach=REACH_PX,
    )


def objective_of(scene: Scene, observation: Observation, person: int = 0, **settings: Any) -> Objective:
    """The objective of contour evidence, of the default components but for the settings."""
    return Objective(Comparison(scene, person, CpuSynthesis(), observation), ContourEvidence(**settings))


def off(body: BodyModel, angle_deg: float, length_m: float, seed: int) -> Array:
    """An error (dof,) of the same size in every parameter, its signs at random."""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], body.dof)
    errors: Array = signs * np.where(body.rotates, np.radians(angle_deg), length_m)
    return errors


def joint_errors_mm(body: BodyModel, q: Array, truth: Array) -> Array:
    """(L,) distances of the landmarks of two poses."""
    gaps = body.landmarks_in_world(q) - body.landmarks_in_world(truth)
    errors: Array = 1000 * np.linalg.norm(gaps, axis=-1)
    return errors
