"""Compiled synthesis on the CPU: traces occluding contours without rendering pictures."""

from __future__ import annotations

from collections import OrderedDict

import cv2
import numpy as np
import pydantic

from tracker.arrays import Array, Array32, Mask, frozen
from tracker.components import component
from tracker.contours import Contours
from tracker.geometry.superquadrics import spread, surface
from tracker.kernels.contour_tracing import trace_contours
from tracker.scene import Scene

# A part shows about 2 n_eta pieces, long ones cut at step_px: 64 were never reached at the default step.
_SAMPLES_PER_PART = 64


@component
class CpuSynthesis:
    """Contour tracer of the superquadric model; needs no graphics library."""

    step_px: float = pydantic.Field(default=8.0, gt=0)
    """Longest piece of contour that one sample stands for, px."""

    contact_m: float = pydantic.Field(default=0.02, ge=0)
    """An edge whose outer side is this close to another part is an edge between parts, metres."""

    n_eta: int = pydantic.Field(default=9, ge=5)
    """Latitudes of the surface grid."""

    n_omega: int = pydantic.Field(default=16, ge=8)
    """Longitudes of the surface grid."""

    def contours(self, scene: Scene, person: int | None = None, poses: Array | None = None) -> Contours:
        """Visible occluding contours; see `tracker.synthesis.Synthesis.contours`."""
        placements = scene.world_from_parts(person, poses)
        found = self._traced(scene, placements, _SAMPLES_PER_PART * len(scene.shapes))
        while int(found.counts.max(initial=0)) == found.parts.shape[2]:
            found = self._traced(scene, placements, 2 * found.parts.shape[2])
        return found

    def _traced(self, scene: Scene, placements: Array, capacity: int) -> Contours:
        """Contours with room for so many samples in a view; further ones are dropped."""
        grids, planes, bounds = _grids(scene.shapes, self.n_eta, self.n_omega)
        layout = (len(placements), len(scene.rig), capacity)
        positions = np.empty((*layout, 5), dtype=np.float32)
        points = np.empty((*layout, 3), dtype=np.float32)
        parts = np.empty(layout, dtype=np.int64)
        between = np.empty(layout, dtype=np.bool_)
        counts = np.zeros(layout[:2], dtype=np.int64)
        trace_contours(
            placements,
            scene.shapes,
            grids,
            planes,
            bounds,
            scene.rig.packed,
            scene.rig.sizes,
            (self.step_px, self.contact_m),
            positions,
            points,
            parts,
            between,
            counts,
        )
        return Contours(positions, points, parts, between, counts)

    def silhouettes(self, scene: Scene) -> tuple[Mask, ...]:
        """The region each view's persons cover: parts are convex, so each fills its points' convex hull."""
        grids, _, _ = _grids(scene.shapes, self.n_eta, self.n_omega)
        points = grids[..., :3].reshape(len(grids), -1, 3).astype(np.float64)
        placements = scene.world_from_parts()[0]
        world = np.einsum("pij,pnj->pni", placements[:, :3, :3], points) + placements[:, None, :3, 3]
        return tuple(_filled(camera.project(world), camera.size) for camera in scene.rig.cameras)


# OpenCV fills every pixel that an outline touches: at four times the resolution that is an eighth of a pixel.
_FINE = 4


def _filled(parts: Array, size: tuple[int, int]) -> Mask:
    """The region (h, w) of an image that the convex hulls of the parts' points (P, N, 2), px, cover."""
    mask = np.zeros(size[::-1], dtype=np.bool_)
    parts = parts[np.isfinite(parts).all(axis=(1, 2))]
    if len(parts) == 0:
        return mask
    low = np.clip(np.floor(parts.min(axis=(0, 1))) - 1, 0, size).astype(int)
    high = np.clip(np.ceil(parts.max(axis=(0, 1))) + 2, 0, size).astype(int)
    if (high <= low).any():
        return mask
    width, height = (high - low).tolist()
    fine = np.zeros((_FINE * height, _FINE * width), dtype=np.uint8)
    for pixels in parts:
        hull = cv2.convexHull(((pixels - low + 0.5) * _FINE - 0.5).astype(np.float32))
        cv2.fillConvexPoly(fine, np.round(hull * 16).astype(np.int32), 255, shift=4)
    covered = cv2.resize(fine, (width, height), interpolation=cv2.INTER_AREA)
    mask[low[1] : high[1], low[0] : high[0]] = covered > 127
    return mask


_CACHE: OrderedDict[tuple[bytes, int, int], tuple[Array32, Array32, Array]] = OrderedDict()


def _grids(shapes: Array, n_eta: int, n_omega: int) -> tuple[Array32, Array32, Array]:
    """Surface grids, their tangent planes and bounds of all parts, kept for the shapes last used."""
    key = (shapes.tobytes(), n_eta, n_omega)
    if key not in _CACHE:
        _CACHE[key] = _make_grids(shapes, n_eta, n_omega)
        while len(_CACHE) > 8:
            _CACHE.popitem(last=False)
    return _CACHE[key]


def _make_grids(shapes: Array, n_eta: int, n_omega: int) -> tuple[Array32, Array32, Array]:
    grids, planes, radii, reaches, widths = [], [], [], [], []
    for shape in shapes:
        eta, omega = spread(shape, 2 * n_eta - 1, 2 * n_omega)
        points, normals = surface(shape, eta[:, None], omega[None, :])
        grids.append(np.concatenate([points, normals], axis=-1))
        corners = normals[::2, ::2].reshape(-1, 3)
        planes.append([*corners.T, (corners * points[::2, ::2].reshape(-1, 3)).sum(axis=1)])
        radii.append(np.linalg.norm(points, axis=-1).max())
        # 4 % more than the grid's farthest point covers the surface between the points
        reaches.append(1.04 * ((points / shape[:3]) ** 2).sum(axis=-1).max())
        widths.append(1.02 * np.linalg.norm(points[..., :2], axis=-1).max())
    return frozen(grids, np.float32), frozen(planes, np.float32), frozen([radii, reaches, widths])
