"""Least squares matching of image patches, and growth of matches over a surface."""

from __future__ import annotations

import numpy as np

import tracker._native as native
from tracker.foundation.arrays import Array, Array32, Integers, Mask

# What Gruen's linearized equations of a patch are told: how patches are matched, and what noise there is.

Rule = tuple[int, int, float, float, float, bool]
"""Half patch px, most iterations, tolerance px, farthest shift px, prior's weight, classical form."""

Noise = tuple[float, float, Array32]
"""Powers that white noise keeps in residuals and in gradients; taps of the smoothing that the images went through."""


# Cubic B-spline interpolation of image patches under an affine transformation.

SplineImage = tuple[Array32, int, int]
"""Spline coefficients of an image, row by row (h * w,), its width and its height, px."""

MARGIN = 2
"""Patches reach no nearer to the border than this, px: the splines need the pixels around."""


def sample_patch(image: SplineImage, warp: Array, half: int, values: Array32) -> None:
    """Grey values under an affinely transformed patch, which must lie inside.

    Args:
        image: spline coefficients, width and height.
        warp: (6,) position of the centre, then the affine matrix row by row.
        half: the patch has 2 half + 1 pixels a side.
        values: (>= n) written, row by row.
    """
    native.sample_patch(image, warp, half, values)


def sample_gradient(
    image: SplineImage, warp: Array, half: int, values: Array32, dx_of: Array32, dy_of: Array32
) -> None:
    """Grey values and image gradients under an affinely transformed patch, as `sample_patch`.

    Args:
        image, warp, half, values: see `sample_patch`.
        dx_of, dy_of: (>= n) written: derivatives along the image's x and y, grey levels per px.
    """
    native.sample_gradient(image, warp, half, values, dx_of, dy_of)


def sample_whole_pixels(
    image: SplineImage, column: int, row: int, half: int, values: Array32, dx_of: Array32, dy_of: Array32
) -> None:
    """Grey values and gradients as `sample_gradient`, of an upright patch whose centre is a whole pixel.

    Three coefficients in a row instead of four, the same ones for all pixels: ten times as fast.
    """
    upright = np.array([column, row, 1.0, 0.0, 0.0, 1.0])
    native.sample_whole_pixels(image, upright, half, values, dx_of, dy_of)


# Adaptive least squares matching of image patches (Gruen 1985): six affine and two radiometric parameters.

MATCHED, NOT_CONVERGED, DRIFTED, OUTSIDE, WEAK = 0, 1, 2, 3, 4
"""How a match ended; WEAK: the patch has too little texture, or looks like its negative."""

WARP, SIGMA0, COVARIANCE, CORRELATION, HALF_PATCH, N_FOUND = slice(0, 6), 8, slice(9, 12), 12, 14, 15
"""Columns of what is found.

0-5 centre px and affine matrix row by row, 6-7 brightness and contrast, 8 sigma0 grey levels, 9-11 variances and
covariance of the shift xx yy xy px^2, 12 correlation, 13 iterations, 14 half the patch px.
"""


def match_patches(
    template: SplineImage, search: SplineImage, at: Array, found: Array, ended: Integers, rule: Rule, noise: Noise
) -> None:
    """Finds N template patches in another image.

    The inverse-compositional form linearizes the template once; the classical form of Gruen (1985) linearizes
    the search image at every iteration. Both minimize the squares of ``brightness + contrast g(A x + c) - f(x)``.

    Args:
        template, search: spline coefficients, width and height of both images.
        at: (N, 2) centres of the template patches, px.
        found: (N, 15) holds the starts, and the results after.
        ended: (N,) written: how each match ended.
        rule: see `Rule`.
        noise: see `Noise`.
    """
    native.match_patches(template, search, at, found, ended, rule, noise)


# Key patches: pieces of an image that are kept, and found again in others by least squares matching.


def key_side(half: int) -> int:
    """Side of the square of spline coefficients that a patch of 2 half + 1 pixels needs."""
    return 2 * (half + MARGIN) + 1


def cut_keys(image: SplineImage, centres: Integers, half: int, keys: Array32, inside: Mask) -> None:
    """Copies the coefficients around N whole pixels.

    Args:
        image: spline coefficients, width and height.
        centres: (N, 2) x, y px.
        half: the patch has 2 half + 1 pixels a side.
        keys: (N, side * side) written, row by row.
        inside: (N,) written: whether the patch lies within the image; keys of others stay as they are.
    """
    native.cut_keys(image, centres, half, keys, inside)


def match_keys(
    keys: Array32, which: Integers, search: SplineImage, found: Array, ended: Integers, rule: Rule, noise: Noise
) -> None:
    """Finds M key patches in an image; see `tracker.kernels.patches.match_patches`.

    Args:
        keys: (N, side * side) from `cut_keys`.
        which: (M,) rows of the keys.
        search, rule, noise: as there.
        found: (M, 15) holds the starts, and the results after.
        ended: (M,) written: how each match ended.
    """
    native.match_keys(keys, which, search, found, ended, rule, noise)


# How far the mean of a followed patch lies from its centre, from the affine terms of its neighbours.

LEAST_NEIGHBOURS = 6
"""Twice the unknowns of a plane through their differences."""

LARGEST_PX = 0.5
"""A larger correction is no curvature but a wrong neighbour."""

NO_SPREAD_PX2 = 1.0
"""Regularizes neighbours that lie at one place."""

NO_SHIFT_PX2 = 1e-12
"""Keeps 0 / 0 away."""


def bending_shifts(offsets: Array, rows: Integers, affine: Array, known: Mask, half: int) -> Array:
    """Shift of each patch's mean against its centre (N, 2) px; 0 where neighbours cannot tell.

    By Taylor's theorem it is ``(s_xx + s_yy) m / 2`` with m the mean square of a pixel's offset along an axis; the
    second derivatives are the slopes of the affine terms over the neighbours. Each shift is multiplied by the Wiener
    weight ``|mean s|^2 / mean |s|^2`` over the point and its neighbours.

    Args:
        offsets: (N, K, 2) of the neighbours from the points at birth, px.
        rows: (N, K) rows of the neighbours, -1 for none.
        affine: (N, 2, 2) from birth to now.
        known: (N,) points whose affine transformations are those of the present frame.
        half: the patch has 2 half + 1 pixels a side.
    """
    shifts = np.empty((len(rows), 2))
    native.bending_shifts(np.ascontiguousarray(offsets), np.ascontiguousarray(rows), affine, known, half, shifts)
    return shifts


# Growth of a match over a grid of the template: from neighbour to neighbour, in a chosen order.

UNTRIED, REJECTED = -1, 5
"""States of a cell beside those of `tracker.kernels.patches`; REJECTED: matched, but not well enough."""

Grid = tuple[int, int, int]
"""Columns, rows, and pixels from one to the next; cell (0, 0) is pixel (0, 0)."""

Limits = tuple[float, float, float, float]
"""Largest sigma0 grey levels, largest standard deviation of a shift px, least correlation, largest stretch."""

Heap = tuple[Array, Integers, Integers]
"""Keys, attempts (cell * 4 + direction), and their number (1,)."""


def stretch(found: Array) -> float:
    """By what factor the affine transformation stretches or compresses the patch most; infinite for a mirrored one."""
    return native.stretch(found)


def push_all(heap: Heap, grid: Grid, found: Array, ended: Integers, seeds: Integers) -> None:
    """Puts the attempts from every matched cell to its open neighbours on the heap.

    Args:
        heap: see `Heap`.
        grid: see `Grid`.
        found, ended: (cells, 15), (cells,) what was found so far.
        seeds: (cells,) nearest seed's cell, within whose region growth stays, rows first (paper, figure 3);
            all -1 for growth without regions, where the most precise match goes on first.
    """
    native.push_all(*heap, grid, found, ended, seeds)


def grow(
    images: tuple[SplineImage, SplineImage],
    grid: Grid,
    state: tuple[Array, Integers, Integers, Integers],
    heap: Heap,
    rules: tuple[Rule, Rule],
    judging: tuple[Noise, Limits],
    budget: tuple[int, int],
) -> int:
    """Works through the heap of attempts; every match adds those of its neighbours.

    An attempt that fails is repeated by way of a point half-way, then with the larger patch.

    Args:
        images: template and search image.
        grid: see `Grid`.
        state: found (cells, 15), ended (cells,), seeds (cells,) as in `push_all`, tries (cells,) so far.
        heap: see `Heap`.
        rules: of the first attempt and of the larger patch.
        judging: see `Noise` and `Limits`.
        budget: attempts in this call, and most tries for a cell.

    Returns:
        Attempts left on the heap.
    """
    found, ended, seeds, tries = state
    (usual, larger), (noise, limits) = rules, judging
    (keys, items, count), (attempts, most) = heap, budget
    return native.grow(
        *images,
        grid,
        found,
        ended,
        seeds,
        tries,
        keys,
        items,
        count,
        usual,
        larger,
        noise,
        limits,
        attempts,
        most,
    )
