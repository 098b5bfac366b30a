"""Growth of a match over a grid of the template: from neighbour to neighbour, in a chosen order."""

from __future__ import annotations

import numpy as np

from tracker.arrays import Array, Integers
from tracker.kernels.compilation import compiled
from tracker.kernels.patches.equations import Noise, Rule, Workspace, workspace
from tracker.kernels.patches.matching import MATCHED, N_FOUND, match_patch
from tracker.kernels.patches.splines import SplineImage

UNTRIED, REJECTED = -1, 5
"""States of a cell beside those of `tracker.kernels.patches.matching`; REJECTED: matched, but not well enough."""

Grid = tuple[int, int, int]
"""Columns, rows, and pixels from one to the next; cell (0, 0) is pixel (0, 0)."""

Limits = tuple[float, float, float, float]
"""Largest sigma0 grey levels, largest standard deviation of a shift px, least correlation, largest stretch."""

Heap = tuple[Array, Integers, Integers]
"""Keys, attempts (cell * 4 + direction), and their number (1,)."""


@compiled
def _push(heap: Heap, key: float, item: int) -> None:
    keys, items, count = heap
    i = count[0]
    if i == len(keys):
        return
    count[0] += 1
    while i > 0 and keys[(i - 1) // 2] > key:
        keys[i], items[i] = keys[(i - 1) // 2], items[(i - 1) // 2]
        i = (i - 1) // 2
    keys[i], items[i] = key, item


@compiled
def _pop(heap: Heap) -> int:
    """Takes out the attempt of the least key."""
    keys, items, count = heap
    result = items[0]
    count[0] -= 1
    n = count[0]
    key, item, i = keys[n], items[n], 0
    while True:
        child = 2 * i + 1
        if child >= n:
            break
        if child + 1 < n and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[i], items[i] = keys[child], items[child]
        i = child
    keys[i], items[i] = key, item
    return result


@compiled
def push_neighbours(heap: Heap, cell: int, grid: Grid, found: Array, ended: Integers, seeds: Integers) -> None:
    """Puts the attempts from a matched cell to its open neighbours on the heap.

    Args:
        heap: see `Heap`.
        cell: the matched cell.
        grid: see `Grid`.
        found, ended: (cells, 15), (cells,) what was found so far.
        seeds: (cells,) nearest seed's cell, within whose region growth stays, rows first (paper, figure 3);
            all -1 for growth without regions, where the most precise match goes on first.
    """
    n_columns, n_rows, _ = grid
    row, column = cell // n_columns, cell % n_columns
    for direction in range(4):
        i, j = column + _along(direction), row + _along(direction - 1)
        if i < 0 or j < 0 or i >= n_columns or j >= n_rows:
            continue
        other = j * n_columns + i
        if ended[other] == MATCHED or seeds[other] != seeds[cell]:
            continue
        if seeds[cell] < 0:
            key = max(found[cell, 9], found[cell, 10])
        else:
            rows, columns = abs(j - seeds[cell] // n_columns), abs(i - seeds[cell] % n_columns)
            key = rows * n_columns + columns + 0.5 * (direction % 2)
        _push(heap, key, cell * 4 + direction)


@compiled
def _along(direction: int) -> int:
    """Horizontal part of the directions right, down, left, up: 1, 0, -1, 0."""
    return (1 - direction) * (1 - direction % 2) if direction >= 0 else 0


@compiled
def accepted(found: Array, limits: Limits) -> bool:
    """Whether a match is good enough."""
    sigma0, deviation, correlation, most = limits
    precise = found[8] <= sigma0 and max(found[9], found[10]) <= deviation * deviation
    return precise and found[12] >= correlation and stretch(found) <= most


@compiled
def stretch(found: Array) -> float:
    """By what factor the affine transformation stretches or compresses the patch most; infinite for a mirrored one."""
    determinant = found[2] * found[5] - found[3] * found[4]
    if not determinant > 0.0:
        return np.inf
    squares = found[2] ** 2 + found[3] ** 2 + found[4] ** 2 + found[5] ** 2
    longest2 = 0.5 * (squares + np.sqrt(max(0.0, squares * squares - 4.0 * determinant * determinant)))
    return max(np.sqrt(longest2), np.sqrt(longest2) / determinant)


@compiled
def _predict(source: Array, dx: float, dy: float, found: Array) -> None:
    """The neighbour's start: the source's patch, carried on by its own affine transformation."""
    found[:] = 0.0
    found[:6] = source[:6]
    found[0] += source[2] * dx + source[3] * dy
    found[1] += source[4] * dx + source[5] * dy


@compiled
def _attempt(
    images: tuple[SplineImage, SplineImage],
    at: Array,
    step: tuple[int, int],
    source: Array,
    found: Array,
    how: tuple[Rule, Noise, Limits, Workspace],
) -> int:
    """Matches one patch from its neighbour's match; returns how that ended."""
    rule, noise, limits, work = how
    _predict(source, step[0], step[1], found)
    ended = match_patch(images[0], images[1], at, found, rule, noise, work)
    if ended == MATCHED and not accepted(found, limits):
        return REJECTED
    return ended


@compiled
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
        state: found (cells, 15), ended (cells,), seeds (cells,) as in `push_neighbours`, tries (cells,) so far.
        heap: see `Heap`.
        rules: of the first attempt and of the larger patch.
        judging: see `Noise` and `Limits`.
        budget: attempts in this call, and most tries for a cell.

    Returns:
        Attempts left on the heap.
    """
    n_columns, _, pixels = grid
    found, ended, seeds, tries = state
    work = workspace(max(rules[0][0], rules[1][0]), len(judging[0][2]))
    usual, larger = (rules[0], *judging, work), (rules[1], *judging, work)
    at, result, between = np.zeros(2), np.zeros(N_FOUND), np.zeros(N_FOUND)
    for _ in range(budget[0]):
        if heap[2][0] == 0:
            break
        item = _pop(heap)
        source, direction = item // 4, item % 4
        right, down = _along(direction), _along(direction - 1)
        target = source + right + down * n_columns
        if ended[target] == MATCHED or ended[source] != MATCHED or tries[target] >= budget[1]:
            continue
        tries[target] += 1
        at[:] = target % n_columns * pixels, target // n_columns * pixels
        step = right * pixels, down * pixels
        outcome = _attempt(images, at, step, found[source], result, usual)
        half_x, half_y = right * (pixels // 2), down * (pixels // 2)
        if outcome != MATCHED and (half_x != 0 or half_y != 0):
            at[0] -= step[0] - half_x
            at[1] -= step[1] - half_y
            way = _attempt(images, at, (half_x, half_y), found[source], between, usual)
            at[:] = target % n_columns * pixels, target // n_columns * pixels
            if way == MATCHED:
                outcome = _attempt(images, at, (step[0] - half_x, step[1] - half_y), between, result, usual)
        if outcome != MATCHED and rules[1][0] > rules[0][0]:
            outcome = _attempt(images, at, step, found[source], result, larger)
        ended[target] = outcome
        if outcome == MATCHED:
            found[target] = result
            push_neighbours(heap, target, grid, found, ended, seeds)
    return heap[2][0]


@compiled
def push_all(heap: Heap, grid: Grid, found: Array, ended: Integers, seeds: Integers) -> None:
    """Puts the attempts from every matched cell to its open neighbours on the heap; see `push_neighbours`."""
    for cell in range(len(ended)):
        if ended[cell] == MATCHED:
            push_neighbours(heap, cell, grid, found, ended, seeds)
