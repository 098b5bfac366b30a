"""Triangulated parts, and where they fall in the images."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np

from tracker.arrays import Array, Integers, Mask, frozen
from tracker.geometry.superquadrics import grid_triangles, spread, surface
from tracker.scene import Scene

NEAREST_M = 0.05
"""Parts that come closer to a camera than this are not drawn, metres."""


@dataclass(frozen=True)
class Meshes:
    """Triangulated parts in their own frames, all with the same triangles."""

    points: Array
    """(P, N, 3) metres."""

    normals: Array
    """(P, N, 3) unit."""

    triangles: Integers
    """(T, 3) vertex numbers, anticlockwise seen from outside."""

    widths: Array
    """(P,) largest distance of the surface from the part's z axis, metres."""


_CACHE: OrderedDict[tuple[bytes, int, int], Meshes] = OrderedDict()


def meshes_of(shapes: Array, n_eta: int, n_omega: int) -> Meshes:
    """Meshes of packed superquadrics (P, 7), kept for the shapes last used."""
    key = (shapes.tobytes(), n_eta, n_omega)
    if key not in _CACHE:
        _CACHE[key] = _triangulated(shapes, n_eta, n_omega)
        while len(_CACHE) > 8:
            _CACHE.popitem(last=False)
    return _CACHE[key]


def _triangulated(shapes: Array, n_eta: int, n_omega: int) -> Meshes:
    points, normals = [], []
    for shape in shapes:
        eta, omega = spread(shape, n_eta, n_omega)
        found = surface(shape, eta[:, None], omega[None, :])
        points.append(found[0].reshape(-1, 3))
        normals.append(found[1].reshape(-1, 3))
    widths = np.linalg.norm(np.array(points)[..., :2], axis=-1).max(axis=1)
    return Meshes(frozen(points), frozen(normals), grid_triangles(n_eta, n_omega), frozen(widths))


def before_cameras(scene: Scene, placements: Array, widths: Array) -> Mask:
    """Which parts lie wholly before which cameras, as `tracker.kernels.contours.tracing` decides it.

    Args:
        scene: its rig and shapes.
        placements: (B, P, 4, 4) world_from_part, metres.
        widths: (P,) from `Meshes`.

    Returns:
        (B, V, P).
    """
    ends = _axis_ends(scene, placements)
    depths = [camera.in_camera(ends)[..., 2].min(axis=-1) for camera in scene.rig.cameras]
    before: Mask = np.stack(depths, axis=1) - widths > NEAREST_M
    return before


def boxes_of(scene: Scene, placements: Array, widths: Array, shown: Mask) -> Integers:
    """Part of each image (B, V, 4) outside of which a pose shows nothing: x, y, width and height, px."""
    ends = _axis_ends(scene, placements)
    boxes = np.zeros((*shown.shape[:2], 4), dtype=np.int64)
    for v, camera in enumerate(scene.rig.cameras):
        pixels = camera.project(ends)
        depths = np.maximum(camera.in_camera(ends)[..., 2].min(axis=-1) - widths, NEAREST_M)
        # a tenth on top covers perspective and lens distortion across the width of a part
        reach = 1.1 * max(camera.matrix[0, 0], camera.matrix[1, 1]) * widths / depths + 2
        seen = shown[:, v, :, None]
        lows = np.where(seen, pixels.min(axis=2) - reach[..., None], np.inf).min(axis=1)
        highs = np.where(seen, pixels.max(axis=2) + reach[..., None], -np.inf).max(axis=1)
        low = np.clip(np.floor(lows), 0, camera.size).astype(np.int64)
        high = np.clip(np.ceil(highs) + 1, 0, camera.size).astype(np.int64)
        boxes[:, v, :2], boxes[:, v, 2:] = low, np.maximum(high - low, 0)
    return boxes


def ranges_of(scene: Scene, placements: Array, widths: Array, shown: Mask) -> Array:
    """Nearest and farthest depth (B, V, 2) of what a pose shows, metres, with a little room."""
    ends = _axis_ends(scene, placements)
    ranges = np.empty((*shown.shape[:2], 2))
    for v, camera in enumerate(scene.rig.cameras):
        depths = camera.in_camera(ends)[..., 2]
        ranges[:, v, 0] = np.where(shown[:, v], depths.min(axis=-1) - widths, np.inf).min(axis=1)
        ranges[:, v, 1] = np.where(shown[:, v], depths.max(axis=-1) + widths, -np.inf).max(axis=1)
    ranges[~shown.any(axis=2)] = 1.0, 2.0
    return ranges * (0.99, 1.01)


def _axis_ends(scene: Scene, placements: Array) -> Array:
    """Both ends of the parts' z axes in the world (B, P, 2, 3), metres."""
    half = scene.shapes[:, 2, None] * placements[..., :3, 2]
    centres = placements[..., :3, 3]
    return np.stack([centres - half, centres + half], axis=2)
