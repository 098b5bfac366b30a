"""Where an edge lies between its pixels, and which way its gradient points."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array32
from tracker.kernels.compilation import compiled
from tracker.kernels.images.linking import Pixels
from tracker.kernels.images.slopes import Slopes

# A Sobel filter counts a grey level per pixel eight times.
_PER_SLOPE = np.float32(1 / 8)


@compiled
def edge_profile(points: Pixels, slopes: tuple[Slopes, Slopes], edges: Array32, directions: Array32) -> None:
    """Sub-pixel positions and gradient directions of edge pixels.

    A parabola goes through the slope, along the gradient's direction, of the pixel and its two neighbours in the
    row or column that the gradient is nearest to; its vertex lies on the edge, whose nearest point is the position.
    Neighbours interpolated along the gradient itself would be smoother than the pixel and draw the vertex to it:
    twice the error on slanted edges.

    Args:
        points: (N, 2) edge pixels x, y.
        slopes: dx, dy (h, w) image gradient.
        edges: (N, 2) output: positions, px.
        directions: (N, 2) output: unit gradient.
    """
    along_x, along_y = slopes
    height, width = along_x.shape
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        gx, gy = _PER_SLOPE * np.float32(along_x[y, x]), _PER_SLOPE * np.float32(along_y[y, x])
        here = np.sqrt(gx * gx + gy * gy) + 1e-9
        ux, uy = gx / here, gy / here
        shift = 0.0
        if 0 < x < width - 1 and 0 < y < height - 1:
            dx, dy = (1, 0) if abs(ux) >= abs(uy) else (0, 1)
            before = _PER_SLOPE * (along_x[y - dy, x - dx] * ux + along_y[y - dy, x - dx] * uy)
            after = _PER_SLOPE * (along_x[y + dy, x + dx] * ux + along_y[y + dy, x + dx] * uy)
            curvature = before - 2.0 * here + after
            if curvature < -1e-6:
                vertex = 0.5 * (before - after) / curvature
                # Half a pixel's diagonal: an edge farther away belongs to another pixel.
                shift = min(max(vertex * (dx * ux + dy * uy), -0.71), 0.71)
        edges[i, 0], edges[i, 1] = x + shift * ux, y + shift * uy
        directions[i, 0], directions[i, 1] = ux, uy
