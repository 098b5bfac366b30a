"""Where triangulated parts fall in the images."""

from __future__ import annotations

import numpy as np

from tracker.bodies.scene import Scene
from tracker.foundation.arrays import Array, Integers, Mask

NEAREST_M = 0.05
"""Parts that come closer to a camera than this are not drawn, metres."""


def before_cameras(scene: Scene, placements: Array, widths: Array) -> Mask:
    """Which parts lie wholly before which cameras, with both ends within the reach of the lens.

    As `tracker.kernels.contours.solids` decides it.

    Args:
        scene: its rig and shapes.
        placements: (B, P, 4, 4) world_from_part, metres.
        widths: (P,) from `Meshes`.

    Returns:
        (B, V, P).
    """
    ends = _axis_ends(scene, placements)
    depths = [camera.in_camera(ends)[..., 2].min(axis=-1) for camera in scene.rig.cameras]
    # what a lens does not image it would lay over other things
    imaged = [np.isfinite(camera.project(ends)).all(axis=(-1, -2)) for camera in scene.rig.cameras]
    before: Mask = (np.stack(depths, axis=1) - widths > NEAREST_M) & np.stack(imaged, axis=1)
    return before


def boxes_of(scene: Scene, placements: Array, widths: Array, shown: Mask) -> Integers:
    """Part of each image (B, V, 4) outside of which a pose shows nothing: x, y, width and height, px."""
    ends = _axis_ends(scene, placements)
    boxes = np.zeros((*shown.shape[:2], 4), dtype=np.int64)
    for v, camera in enumerate(scene.rig.cameras):
        pixels, local = camera.project(ends), camera.in_camera(ends)
        depths = np.maximum(local[..., 2].min(axis=-1) - widths, NEAREST_M)
        # as `tracker.kernels.contours.solids` has it: off the axis a width is drawn out, else a tenth on top covers it
        drawn_out = (np.linalg.norm(local, axis=-1) / np.maximum(local[..., 2], NEAREST_M)).max(axis=-1).clip(min=1.1)
        reach = drawn_out * max(camera.matrix[0, 0], camera.matrix[1, 1]) * widths / depths + 2
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
