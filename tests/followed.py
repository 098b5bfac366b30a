"""Followed points of a known body: what a faultless following would write, and with the usual faults."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Integers
from tracker.foundation.geometry.superquadrics import signed_distance, spread, surface

FACING = 0.4
"""Points are seen where the surface faces the camera by this cosine."""


@dataclass(frozen=True)
class OnBody:
    """N points on the parts of a body."""

    part: Integers
    place: Array
    """(N, 3) in the part's frame, metres."""

    normal: Array

    def in_world(self, body: BodyModel, q: Array) -> tuple[Array, Array]:
        """Places and normals (N, 3) at a pose (dof,)."""
        placed = body.world_from_part(q)[self.part]
        turned = (placed[:, :3, :3] @ np.stack([self.place, self.normal], axis=-1)).transpose(2, 0, 1)
        return turned[0] + placed[:, :3, 3], turned[1]


def on_body(body: BodyModel, n_eta: int = 9, n_omega: int = 12) -> OnBody:
    """Points spread over all parts."""
    parts, places, normals = [], [], []
    for p, shape in enumerate(body.shapes):
        eta, omega = spread(shape, n_eta, n_omega)
        point, normal = surface(shape, eta[1:-1, None], omega[None, :])
        parts.append(np.full(point[..., 0].size, p))
        places.append(point.reshape(-1, 3))
        normals.append(normal.reshape(-1, 3))
    return OnBody(np.concatenate(parts), np.concatenate(places), np.concatenate(normals))


def outer(body: BodyModel, points: OnBody, q: Array) -> Array:
    """(N,) whether a point lies on the outside: in no other part."""
    world, placed = points.in_world(body, q)[0], body.world_from_part(q)
    inside = np.zeros(len(world), dtype=bool)
    for p, (shape, own) in enumerate(zip(body.shapes, placed, strict=True)):
        # less than half a millimetre outside of another part nobody can tell on which of them a point lies
        deep = signed_distance(shape, (world - own[:3, 3]) @ own[:3, :3])[0] < 0.0005
        inside |= deep & (points.part != p)
    return ~inside


def seen_from(rig: Rig, v: int, body: BodyModel, points: OnBody, q: Array) -> tuple[Array, Array]:
    """Pixels (N, 2) in a view, and (N,) which of them it shows."""
    camera, (world, normals) = rig.cameras[v], points.in_world(body, q)
    towards = camera.centre - world
    facing = (normals * towards).sum(axis=1) / np.linalg.norm(towards, axis=1)
    seen = (facing > FACING) & outer(body, points, q)
    placed = body.world_from_part(q)
    for shape, own in zip(body.shapes, placed, strict=True):
        start, end = ((place - own[:3, 3]) @ own[:3, :3] for place in (world + 0.02 * normals, camera.centre[None]))
        steps = np.linspace(0, 0.3, 40)[:, None, None]
        seen &= (signed_distance(shape, start + steps * (end - start))[0] > 0).all(axis=0)
    return camera.project(world), seen


def written(places: Array, sigma: float, noise: float, path: Path, seed: int = 0, fps: float = 25.0) -> Path:
    """The table of `bodytrack follow` of places (T, N, D), NaN where hidden, with Gaussian noise."""
    noisy = places + noise * np.random.default_rng(seed).normal(size=places.shape)
    axes, unit = ("xy", "px") if places.shape[2] == 2 else ("xyz", "m")
    lines = [",".join(["frame,time_s,point", *(f"{kind}{axis}_{unit}" for kind in ("", "sigma_") for axis in axes)])]
    for t, n in np.argwhere(np.isfinite(noisy[..., 0])):
        cells = [f"{value:.6f}" for value in [*noisy[t, n], *[sigma] * len(axes)]]
        lines.append(",".join([f"{t},{t / fps:.6f},{n}", *cells]))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def followed(body: BodyModel, poses: Array, rig: Rig, folder: Path, noise_px: float = 0.3) -> str:
    """A path of tables of points that each view shows at poses (T, dof) of a body."""
    points = on_body(body)
    for v, name in enumerate(rig.names):
        shown = [seen_from(rig, v, body, points, q) for q in poses]
        places = np.array([np.where(seen[:, None], pixels, np.nan) for pixels, seen in shown])
        places = places[:, np.isfinite(places[..., 0]).any(axis=0)]
        written(places, max(noise_px, 0.05), noise_px, folder / name / "trajectories.csv", seed=v)
    return str(folder / "{view}")


def in_space(body: BodyModel, poses: Array, folder: Path, noise_m: float = 0.001) -> Path:
    """A table of points in space, seen in all frames."""
    points = on_body(body)
    kept = np.all([outer(body, points, q) for q in poses], axis=0)
    places = np.array([points.in_world(body, q)[0][kept] for q in poses])
    return written(places, max(noise_m, 1e-4), noise_m, folder / "trajectories.csv")
