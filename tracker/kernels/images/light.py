"""How the light of an image differs from that of its clean plate, and the plate in the image's light."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Array32, Image, Mask
from tracker.kernels.compilation import compiled

DARK = 6.0
"""Grey levels added before ratios are taken: where there is hardly any light, noise decides them."""


@compiled
def block_ratios(now: Image, plate: Image, size: int, step: int) -> Array:
    """Median log ratio of image and plate in square blocks.

    Args:
        now: (h, w, 3) image.
        plate: (h, w, 3) its plate.
        size: side of a block, px; what is left over at the right and below is left out.
        step: take every so many pixels of a block's row, and of its column.

    Returns:
        (h // size, w // size, 3).
    """
    n_rows, n_columns = now.shape[0] // size, now.shape[1] // size
    ratios = np.empty((n_rows, n_columns, 3))
    n = len(range(0, size, step)) ** 2
    values = np.empty((3, n), dtype=np.float32)
    for row in range(n_rows):
        for column in range(n_columns):
            found = 0
            for y in range(row * size, (row + 1) * size, step):
                for x in range(column * size, (column + 1) * size, step):
                    for c in range(3):
                        values[c, found] = (now[y, x, c] + DARK) / (plate[y, x, c] + DARK)
                    found += 1
            for c in range(3):
                ratios[row, column, c] = _log_median(values[c])
    return ratios


@compiled
def _log_median(values: Array32) -> float:
    """Logarithm of the median; of an even number the mean of both. The values are used up.

    Half of them are sorted, by selection: it branches less than insertion, for which most of the time went.
    """
    n = len(values)
    for i in range(n // 2 + 1):
        least = values[i]
        for k in range(i + 1, n):
            other = values[k]
            values[k] = max(least, other)
            least = min(least, other)
        values[i] = least
    if n % 2:
        return float(np.log(values[n // 2]))
    return float(0.5 * (np.log(values[n // 2 - 1]) + np.log(values[n // 2])))


@compiled
def smooth_surface(ratios: Array, least: float, n_steps: int, stride: int) -> Array:
    """The quadratic surface that most blocks agree with, by iteratively weighted least squares (Cauchy's weights).

    Args:
        ratios: (n, m, 3) log ratios of blocks.
        least: smallest departure that weighs a half.
        n_steps: number of iterations.
        stride: take every so many blocks in both directions.

    Returns:
        (n, m, 3) the surface; one weight serves the three channels of a block.
    """
    n_rows, n_columns = ratios.shape[:2]
    terms = np.empty((n_rows, n_columns, 6))
    for row in range(n_rows):
        for column in range(n_columns):
            x, y = 2 * (column + 0.5) / n_columns - 1, 2 * (row + 0.5) / n_rows - 1
            terms[row, column] = 1.0, x, y, x * x, x * y, y * y
    taken = np.ascontiguousarray(terms[::stride, ::stride]).reshape(-1, 6)
    values = np.ascontiguousarray(ratios[::stride, ::stride]).reshape(-1, 3)
    weights = np.ones(len(values))
    factors: Array = np.zeros((6, 3))
    for c in range(3):
        factors[0, c] = np.median(values[:, c])
    for _ in range(n_steps):
        fitted = taken @ factors
        for i in range(len(values)):
            weights[i] = np.abs(values[i] - fitted[i]).max()
        half = max(np.median(weights), least)
        for i in range(len(values)):
            weights[i] = 1 / (1 + (weights[i] / half) ** 2)
        weighted = np.ascontiguousarray((taken * weights.reshape(-1, 1)).T)
        solved = np.linalg.solve(weighted @ taken + 1e-6 * np.eye(6), weighted @ values)
        factors = np.ascontiguousarray(solved)
    return (terms.reshape(-1, 6) @ factors).reshape(n_rows, n_columns, 3)


@compiled
def connected_blocks(departures: Array, most: float) -> Mask:
    """Blocks near the surface, and those that a way of small steps from block to block leads to.

    Light falls off smoothly, however far; the outline of a person is a step.

    Args:
        departures: (n, m, 3) log ratios of blocks less the surface.
        most: largest departure of a block to begin with, and largest step to one of the four neighbours.

    Returns:
        (n, m).
    """
    n_rows, n_columns = departures.shape[:2]
    reached = np.zeros((n_rows, n_columns), dtype=np.bool_)
    queue, end = np.empty(n_rows * n_columns, dtype=np.int64), 0
    for row in range(n_rows):
        for column in range(n_columns):
            if np.abs(departures[row, column]).max() < most:
                reached[row, column] = True
                queue[end] = row * n_columns + column
                end += 1
    start = 0
    while start < end:
        row, column = queue[start] // n_columns, queue[start] % n_columns
        start += 1
        for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            y, x = row + dy, column + dx
            if not (0 <= y < n_rows and 0 <= x < n_columns) or reached[y, x]:
                continue
            if np.abs(departures[y, x] - departures[row, column]).max() < most:
                reached[y, x] = True
                queue[end] = y * n_columns + x
                end += 1
    return reached


@compiled
def relight(picture: Image, gains: Array32, size: float, geometry: tuple[int, int, int], lit: Image) -> None:
    """A part of a plate in another light.

    Args:
        picture: (h, w, 3) part of the plate.
        gains: (n, m, 3) ratio of the light in each block; between the blocks' centres it is bilinear, beyond the
            outermost ones it is theirs.
        size: side of a block, px of the plate.
        geometry: place (x, y) in the plate of the part's first pixel, and pixels of the plate from one to the next.
        lit: (h, w, 3) output.
    """
    height, width = lit.shape[:2]
    n_rows, n_columns = gains.shape[:2]
    wide = np.empty((n_rows, 3 * width), dtype=np.float32)
    for x in range(width):
        left, right, share = _between((geometry[0] + x * geometry[2] + 0.5) / size - 0.5, n_columns)
        for k in range(n_rows):
            for c in range(3):
                wide[k, 3 * x + c] = gains[k, left, c] + share * (gains[k, right, c] - gains[k, left, c])
    for y in range(height):
        above, below, share = _between((geometry[1] + y * geometry[2] + 0.5) / size - 0.5, n_rows)
        _relight_row(picture[y].reshape(-1), wide[above], wide[below], share, lit[y].reshape(-1))


@compiled
def _between(place: float, n: int) -> tuple[int, int, np.float32]:
    """The two nodes of a line of n between which a place lies, and how far it is from the first to the second."""
    place = min(max(place, 0.0), n - 1.0)
    first = min(int(place), max(n - 2, 0))
    return first, min(first + 1, n - 1), np.float32(place - first)


@compiled(fastmath=True)
def _relight_row(row: Image, above: Array32, below: Array32, share: np.float32, lit: Image) -> None:
    dark, half, most = np.float32(DARK), np.float32(0.5), np.float32(255.5)
    for x in range(len(row)):
        gain = above[x] + share * (below[x] - above[x])
        level = (np.float32(row[x]) + dark) * gain - dark + half
        lit[x] = np.uint8(np.int32(min(max(level, half), most)))
