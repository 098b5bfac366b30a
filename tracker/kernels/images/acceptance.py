"""What accepting segments as units needs of each edge: distance to the expected contours, marks in pictures."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array32, Image, Integers, Mask
from tracker.kernels.compilation import compiled

# Edges that lie side by side in their chain share their candidates among the samples.
_BLOCK = 32

Columns = tuple[Array32, Array32]


@compiled
def marked(points: Array32, picture: Image, origin: tuple[int, int], marks: Mask) -> None:
    """Which points a picture is set at; beyond the picture it is not.

    Args:
        points: (N, 2) px of the whole image.
        picture: (h, w).
        origin: pixel (x, y) of its upper left corner.
        marks: (N,) output.
    """
    height, width = picture.shape
    for i in range(len(points)):
        x, y = int(np.rint(points[i, 0])) - origin[0], int(np.rint(points[i, 1])) - origin[1]
        marks[i] = 0 <= x < width and 0 <= y < height and picture[y, x] != 0


@compiled(fastmath={"nnan", "ninf", "nsz"})
def expected_distances(
    edges: Array32, directions: Array32, samples: Array32, bend_px: float, most_px: float
) -> Array32:
    """Distance of each edge point to the nearest expected contour sample, clamped.

    A sample whose normal is at angle a to the gradient is farther by ``bend_px |sin a|``: lines across a limb
    do not count as its contour. Any order of the edges gives the same distances; in chains, where neighbours
    follow each other, few samples are compared.

    Args:
        edges: (N, 2) px.
        directions: (N, 2) unit gradients.
        samples: (M, 4) pixel and unit normal.
        bend_px: distance that a right angle between the directions counts, px.
        most_px: largest value, px; also where there is no sample.

    Returns:
        (N,) px.
    """
    n_edges = len(edges)
    found = np.empty(n_edges, dtype=np.float32)
    xs, ys = samples[:, 0].copy(), samples[:, 1].copy()
    normals_x, normals_y = samples[:, 2].copy(), samples[:, 3].copy()
    chosen, near = np.empty(len(samples), dtype=np.int64), np.empty(len(samples), dtype=np.float32)
    x, y, gx, gy, best = np.zeros((5, _BLOCK), dtype=np.float32)
    for first in range(0, n_edges, _BLOCK):
        n = min(_BLOCK, n_edges - first)
        for i in range(n):
            x[i], y[i] = edges[first + i, 0], edges[first + i, 1]
            gx[i], gy[i] = directions[first + i, 0], directions[first + i, 1]
        best[:] = np.float32(most_px * most_px)
        for c in range(_near_box((x[:n], y[:n]), (xs, ys), most_px, near, chosen)):
            m = chosen[c]
            _lower((x, y, gx, gy), (xs[m], ys[m], normals_x[m], normals_y[m]), bend_px, best)
        for i in range(n):
            found[first + i] = np.sqrt(best[i])
    return found


@compiled(fastmath={"nnan", "ninf", "nsz"})
def _near_box(points: Columns, samples: Columns, most_px: float, near: Array32, chosen: Integers) -> int:
    """Which samples are near the box of some points.

    Args:
        points: x, y (n,) px.
        samples: x, y (M,) px.
        most_px: largest distance from the box, px.
        near: (M,) scratch.
        chosen: (M,) output: the indices of the samples, in order.

    Returns:
        Their number.
    """
    half, zero = np.float32(0.5), np.float32(0)
    (x, y), (xs, ys) = points, samples
    centre_x, centre_y = half * (x.min() + x.max()), half * (y.min() + y.max())
    half_x, half_y = half * (x.max() - x.min()), half * (y.max() - y.min())
    for m in range(len(xs)):
        dx, dy = max(abs(xs[m] - centre_x) - half_x, zero), max(abs(ys[m] - centre_y) - half_y, zero)
        near[m] = dx * dx + dy * dy
    n = 0
    limit = np.float32(most_px * most_px)
    for m in range(len(xs)):
        chosen[n] = m
        n += near[m] < limit
    return n


@compiled(fastmath={"nnan", "ninf", "nsz"})
def _lower(
    block: tuple[Array32, Array32, Array32, Array32], sample: tuple[float, ...], bend_px: float, best: Array32
) -> None:
    """Lowers the squared distances of a block of edges to those to one sample.

    A loop over the samples would look for the least of them one by one: this one works in vectors.

    Args:
        block: x, y, px, and unit gradients x, y of the edges.
        sample: x, y, px, and unit normal x, y.
        bend_px: see `expected_distances`.
        best: squared distances; lowered, px^2.
    """
    (x, y, gx, gy), (px, py, nx, ny) = block, sample
    penalty = np.float32(bend_px * bend_px)
    for i in range(_BLOCK):
        dx, dy = x[i] - px, y[i] - py
        sine = gx[i] * ny - gy[i] * nx
        best[i] = min(best[i], dx * dx + dy * dy + penalty * sine * sine)
