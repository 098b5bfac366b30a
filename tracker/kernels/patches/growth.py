"""Growth of a match over a grid of the template: from neighbour to neighbour, in a chosen order."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array, Integers
from tracker.kernels.patches.equations import Noise, Rule
from tracker.kernels.patches.splines import SplineImage

UNTRIED, REJECTED = -1, 5
"""States of a cell beside those of `tracker.kernels.patches.matching`; REJECTED: matched, but not well enough."""

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
