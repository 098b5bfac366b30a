"""How much of what has moved a pose covers, for thousands of poses: parts are taken for rods in the images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Array32, Mask
from tracker.kernels.pictures import covered_by_rods

# Pixels of a view that are asked for: a choice.
_PIXELS = 150
# Clothes, and the blur of small pictures.
_CLOTHES_M = 0.03


@dataclass(frozen=True)
class Moved:
    """What of a person differs from what the views show most of the time."""

    pixels: tuple[Array32 | None, ...]
    """(N, 2) some pixels of each view; None where it is not known which are the person's."""

    @property
    def known(self) -> bool:
        """Whether anything is known to have moved."""
        return any(pixels is not None for pixels in self.pixels)

    def covered(self, body: BodyModel, poses: Array, rig: Rig) -> Array:
        """(B,) share of the pixels that poses (B, dof) cover, mean of the views; 1 where nothing has moved."""
        if not self.known:
            return np.ones(len(poses))
        placed = body.world_from_part(poses)
        views = [(rig.cameras[v], pixels) for v, pixels in enumerate(self.pixels) if pixels is not None]
        covered: Array = np.mean([_covered(body, placed, camera, pixels) for camera, pixels in views], axis=0)
        return covered


NOTHING = Moved(())
"""Where it is not known what has moved."""


def moved(masks: tuple[Mask | None, ...]) -> Moved:
    """Pixels spread over masks (H, W) of what has moved."""
    chosen: list[Array32 | None] = []
    for mask in masks:
        pixels = np.zeros((0, 2), np.float32) if mask is None else np.argwhere(mask)[:, ::-1].astype(np.float32)
        few = np.linspace(0, len(pixels) - 1, min(_PIXELS, len(pixels))).astype(np.int64)
        chosen.append(pixels[few] if len(pixels) else None)
    return Moved(tuple(chosen))


def _covered(body: BodyModel, placed: Array, camera: Camera, pixels: Array32) -> Array:
    """(B,) share of pixels (N, 2) of a view inside the rods of parts placed (B, P, 4, 4)."""
    along = placed[..., :3, 2] * body.shapes[:, 2, None]
    radius = body.shapes[:, :2].max(axis=1)
    depth = np.maximum(camera.in_camera(placed[..., :3, 3])[..., 2], 0.1)
    ends = [camera.project(placed[..., :3, 3] + side * along).astype(np.float32) for side in (-1, 1)]
    reach_px = (camera.matrix[0, 0] * (radius + _CLOTHES_M) / depth).astype(np.float32)
    shares = np.empty(len(placed))
    covered_by_rods(ends[0], ends[1] - ends[0], reach_px, pixels, shares)
    return shares
