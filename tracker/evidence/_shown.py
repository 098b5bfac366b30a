"""Which part of a scene a view shows where, for little time."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array, Integers, Mask, frozen
from tracker.foundation.geometry.superquadrics import meshes_of
from tracker.kernels.pictures import draw_nearest, project_surfaces

_GRID = 7, 10
"""Latitudes and longitudes of the surfaces."""

_GROWN = 1.02
"""Chords lie inside, by this at most between ten longitudes."""


@dataclass(frozen=True)
class Shown:
    """What a view shows of the scene's parts, in the box around them."""

    corner: Integers
    """(2,) x and y of the box's first pixel."""

    parts: NDArray[np.int16]
    """(H, W) number of the part, -1 for none."""

    def at(self, pixels: Array) -> Integers:
        """(N,) part at pixels (N, 2) of the view; -1 outside the box."""
        x, y = (np.round(pixels).astype(np.int64) - self.corner).T
        height, width = self.parts.shape
        inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
        found: Integers = np.full(len(pixels), -1, dtype=np.int64)
        found[inside] = self.parts[y[inside], x[inside]]
        return found

    def inner(self, margin_px: int, trusted: Mask) -> Mask:
        """(H, W) pixels of trusted parts with nothing but the same part so far around."""
        window = np.ones((2 * margin_px + 1,) * 2, dtype=np.uint8)
        same = cv2.erode(self.parts, window) == cv2.dilate(self.parts, window)
        inner: Mask = np.append(trusted, False)[self.parts] & same
        return inner


def seen_parts(scene: Scene, view: int) -> Shown:
    """Which part of the scene a view shows where, from a depth buffer of coarse surfaces.

    For 0.2 ms a view, as hulls of visible contours took; of what they said 2 % was wrong, 10 % at worst, and they had
    nothing of a chest whose outline two arms hide. Pixels at boundaries of parts are not to be asked about.

    Args:
        scene: persons at their poses; those with a skin by the parts that stand for it.
        view: number of the view.
    """
    camera, meshes = scene.rig.cameras[view], meshes_of(scene.shapes, *_GRID)
    seen = np.empty((len(scene.shapes), 3, meshes.points.shape[1]))
    points, wanted = frozen(_GROWN * meshes.points), np.ones(len(scene.shapes), dtype=np.bool_)
    project_surfaces(scene.world_from_parts()[0], points, wanted, scene.rig.packed[view], seen)
    pixels = seen[~np.isnan(seen[:, 0, 0]), :2]
    if not len(pixels):
        return Shown(np.zeros(2, dtype=np.int64), np.full((1, 1), -1, dtype=np.int16))
    end = np.array(camera.size) - 1
    low = np.clip(np.floor(pixels.min(axis=(0, 2))), 0, end).astype(np.int64)
    high = np.clip(np.ceil(pixels.max(axis=(0, 2))), low, end).astype(np.int64)
    depths = np.zeros((high - low + 1)[::-1], dtype=np.float32)
    parts = np.full(depths.shape, -1, dtype=np.int16)
    draw_nearest(seen, meshes.triangles, (int(low[0]), int(low[1])), depths, parts)
    return Shown(low, parts)
