"""Solids and persons at random before cameras of several kinds, and an oracle of what hides them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from rig_samples import FISHEYE
from scipy.spatial.transform import Rotation

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.bodies.contours import ViewContours
from tracker.bodies.scene import Person
from tracker.bodies.segments import Parameter, Part, TaperedSuperquadric
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array
from tracker.foundation.geometry.superquadrics import inside_outside
from tracker.foundation.resources import model_path

SHAPES = {
    "sphere": (0.2, 0.2, 0.2, 1.0, 1.0, 0.0, 0.0),
    "ellipsoid": (0.1, 0.2, 0.4, 1.0, 1.0, 0.0, 0.0),
    "can": (0.05, 0.04, 0.3, 0.3, 1.0, 0.0, 0.0),
    "limb": (0.06, 0.05, 0.25, 0.5, 1.0, -0.26, -0.2),
    "torso": (0.11, 0.165, 0.33, 0.45, 0.85, 0.2, 0.06),
    "cone": (0.1, 0.1, 0.2, 0.6, 0.9, -0.7, -0.7),
    "box": (0.1, 0.2, 0.3, 0.2, 0.2, 0.0, 0.0),
}

MIDDLE = np.array([0.0, 0.0, 1.0])

SLIDE = Parameter("x", rotates=False, axis=np.eye(3)[0], point=np.zeros(3), limits=(-9.0, 9.0), parent=-1)

MODELS = ("gavrila22", "quadruped")


def camera_at(
    place: tuple[float, float, float] = (5.2, 0.3, 2.3), lens: tuple[float, ...] = (0, 0, 0, 0, 0), focal: float = 850.0
) -> Camera:
    camera = Camera.looking_at(str(place), (720, 576), focal, place, MIDDLE)
    return replace(camera, distortion=np.array(lens))


LENS = (-0.2, 0.08, 0.001, -0.002, 0.0)

RIGS = {
    "narrow": Rig((camera_at(), camera_at((-3.6, 3.6, 2.3)), camera_at((-3.4, -3.9, 0.4)))),
    "distorted": Rig((camera_at(lens=LENS), camera_at((-3.6, 3.6, 2.3), LENS))),
    "fisheye": Rig((camera_at((2.1, 0.3, 1.8), FISHEYE, 330.0), camera_at((-1.6, 1.4, 0.6), FISHEYE, 330.0))),
    "wide": Rig((camera_at((2.0, 0.3, 1.8), focal=300.0), camera_at((-1.5, 1.0, 1.5), focal=300.0))),
}


def solid(name: str, rng: np.random.Generator, spread: float = 0.8) -> Part:
    """A shape turned and placed at random around the middle of the room."""
    row = np.array(SHAPES[name])
    placement = np.eye(4)
    placement[:3, :3] = Rotation.random(rng=rng).as_matrix()
    placement[:3, 3] = MIDDLE + rng.uniform(-spread, spread, 3)
    return Part(name, name, 0, TaperedSuperquadric(row[:3], row[3:5], row[5:]), placement)


def thing(*parts: Part) -> Person:
    """Rigid solids that slide along x."""
    return Person("thing", BodyModel("thing", (SLIDE,), parts, (), {}), np.zeros(1))


def posed(name: str, n: int, seed: int = 1) -> list[Person]:
    """A body in poses anywhere inside its joint limits, upright or lying."""
    body = load_body(model_path(name))
    low, high = body.limits.T
    reach = np.where(body.rotates, np.pi, 0.5)
    low, high = np.maximum(low, -reach), np.minimum(high, reach)
    poses = np.random.default_rng(seed).uniform(low, high, (n, body.dof))
    poses[:, 2] += 0.9
    return [Person(name, body, q) for q in poses]


def least(shape: Array, part_from_world: Array, eye: Array, points: Array, n: int = 300) -> Array:
    """Oracle of visibility: least inside-outside value (N,) of a part on the way from the eye to the points (N, 3)."""
    start = part_from_world[:3, :3] @ eye + part_from_world[:3, 3]
    way = points @ part_from_world[:3, :3].T + part_from_world[:3, 3] - start
    length2 = (way**2).sum(axis=1)
    along = -(way @ start) / length2
    radius2 = 1.02 * ((1 + np.abs(shape[5:]).max()) ** 2 * (shape[:2] ** 2).sum() + shape[2] ** 2)
    gap = radius2 - ((start + along[:, None] * way) ** 2).sum(axis=1)
    half = np.sqrt(np.maximum(gap, 0) / length2)
    low, high = np.maximum(along - half, 0), np.minimum(along + half, 1)
    met = np.flatnonzero((gap > 0) & (high > low))
    t = low[met, None] + (high - low)[met, None] * np.linspace(0, 1, n)
    values = np.full(len(points), 99.0)
    values[met] = inside_outside(shape, start + t[..., None] * way[met, None]).min(axis=1)
    return values


def outline_errors(view: ViewContours, part: Part, camera: Camera, reach_px: float = 6.0) -> Array:
    """How far (N,) px the samples of a lone part lie inside its true outline, by bisection on viewing rays."""
    low, high = np.full(len(view.parts), -reach_px), np.full(len(view.parts), reach_px)
    for _ in range(11):
        middle = (low + high) / 2
        far = camera.centre + 12 * camera.rays(view.pixels + middle[:, None] * view.normals)
        inside = least(part.shape.packed, np.linalg.inv(part.model_from_part), camera.centre, far) < 1
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return (low + high) / 2
