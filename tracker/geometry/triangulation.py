"""Points from their images in several views, with covariances."""
from __future__ import annotations
from collections.abc import Sequence
from tracker.arrays import Array
from tracker.camera import Camera

def triangulate(cameras: Sequence[Camera], pixels: Array, sigma_px: float = 1.0) -> tuple[Array, Array]:
    raise NotImplementedError
