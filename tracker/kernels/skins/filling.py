"""The region of an image that a mesh covers."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Integers, Mask
from tracker.kernels.compilation import compiled
from tracker.kernels.projection import project_point


@compiled
def fill_mesh(points: Array, faces: Integers, camera: Array, mask: Mask) -> None:
    """Sets the pixels whose centres triangles cover, from whichever side they are seen.

    Args:
        points: (N, 3) vertices, world, metres.
        faces: (T, 3) vertex numbers.
        camera: (29,) row of `Rig.packed`.
        mask: (h, w) in and out; triangles that are not wholly before the camera are left out.
    """
    height, width = mask.shape
    pixels, depths = np.empty((len(points), 2)), np.empty(len(points))
    for i in range(len(points)):
        pixels[i, 0], pixels[i, 1], depths[i] = project_point(camera, points[i, 0], points[i, 1], points[i, 2])
    for f in range(len(faces)):
        p, q, r = faces[f, 0], faces[f, 1], faces[f, 2]
        if min(depths[p], depths[q], depths[r]) <= 0.05:
            continue
        top = max(int(np.ceil(min(pixels[p, 1], pixels[q, 1], pixels[r, 1]))), 0)
        bottom = min(int(np.floor(max(pixels[p, 1], pixels[q, 1], pixels[r, 1]))), height - 1)
        for row in range(top, bottom + 1):
            left, right = np.inf, -np.inf
            for k in range(3):
                a, b = faces[f, k], faces[f, (k + 1) % 3]
                low, high = min(pixels[a, 1], pixels[b, 1]), max(pixels[a, 1], pixels[b, 1])
                if low <= row <= high:
                    share = (row - pixels[a, 1]) / (pixels[b, 1] - pixels[a, 1]) if high > low else 0.0
                    u = pixels[a, 0] + share * (pixels[b, 0] - pixels[a, 0])
                    left, right = min(left, u), max(right, u)
            if left <= right and right >= 0.0 and left <= width:
                for column in range(max(int(np.ceil(left)), 0), min(int(np.floor(right)), width - 1) + 1):
                    mask[row, column] = True
