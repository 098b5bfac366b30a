"""Z-buffer rasterization of triangle meshes, for pictures and exact part masks."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Array32, Integers
from tracker.kernels.compilation import compiled


@compiled
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
    height, width = buffers.shape[:2]
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ax, ay = pixels[a, 0] - origin[0], pixels[a, 1] - origin[1]
        bx, by = pixels[b, 0] - origin[0], pixels[b, 1] - origin[1]
        cx, cy = pixels[c, 0] - origin[0], pixels[c, 1] - origin[1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if abs(area) < 1e-12:
            continue
        low_x, high_x = max(int(np.ceil(min(ax, bx, cx))), 0), min(int(np.floor(max(ax, bx, cx))), width - 1)
        low_y, high_y = max(int(np.ceil(min(ay, by, cy))), 0), min(int(np.floor(max(ay, by, cy))), height - 1)
        za, zb, zc = 1.0 / depths[a], 1.0 / depths[b], 1.0 / depths[c]
        for y in range(low_y, high_y + 1):
            for x in range(low_x, high_x + 1):
                u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                w = 1.0 - u - v
                if u < 0.0 or v < 0.0 or w < 0.0:
                    continue
                near = u * za + v * zb + w * zc
                if near > buffers[y, x, 0]:
                    buffers[y, x, 0] = near
                    buffers[y, x, 1] = t
                    buffers[y, x, 2] = u * za / near
                    buffers[y, x, 3] = v * zb / near
