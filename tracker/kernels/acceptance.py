"""Distance from scene edges to expected contours, for accepting segments as units."""

from __future__ import annotations

import numpy as np
from numba import njit

from tracker.arrays import Array32


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "ninf", "nsz"})
def expected_distances(edges: Array32, directions: Array32, samples: Array32, bend_px: float) -> Array32:
    """Distance of each edge point to the nearest expected contour sample.

    A sample whose normal is at angle a to the gradient is farther by ``bend_px |sin a|``: lines across a limb
    do not count as its contour.

    Args:
        edges: (N, 2) px.
        directions: (N, 2) unit gradients.
        samples: (M, 4) pixel and unit normal.
        bend_px: distance that a right angle between the directions counts, px.

    Returns:
        (N,) px; large where there is no sample.
    """
    n = len(edges)
    x, y = np.ascontiguousarray(edges[:, 0]), np.ascontiguousarray(edges[:, 1])
    gx, gy = np.ascontiguousarray(directions[:, 0]), np.ascontiguousarray(directions[:, 1])
    best = np.full(n, np.float32(1e12))
    penalty = np.float32(bend_px * bend_px)
    for m in range(len(samples)):
        px, py, nx, ny = samples[m, 0], samples[m, 1], samples[m, 2], samples[m, 3]
        for i in range(n):
            dx, dy = x[i] - px, y[i] - py
            sine = gx[i] * ny - gy[i] * nx
            best[i] = min(best[i], dx * dx + dy * dy + penalty * sine * sine)
    return np.sqrt(best)
