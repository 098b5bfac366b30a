"""Z-buffer rasterization of triangle meshes, for pictures and exact part masks."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Integers


def rasterize(pixels: Array, depths: Array, triangles: Integers, origin: tuple[int, int], buffers: Array32) -> None:
    """Draws triangles into a depth buffer with perspective-correct interpolation.

    Args:
        pixels: (N, 2) vertices in the image, px.
        depths: (N,) their depths, metres.
        triangles: (T, 3) vertex indices.
        origin: x, y of the buffer's first pixel in the image, px.
        buffers: (h, w, 4) in and out: inverse depth (0 where empty), triangle index, and the barycentric weights of
            its first two vertices.
    """
    native.rasterize(pixels, depths, triangles, origin, buffers)
