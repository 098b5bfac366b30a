"""Standard errors of cameras that boards calibrate: what is independent are the board's positions, not its corners.

The residuals of a picture belong together: blur, a lens that the model does not quite follow and a board that is not
quite flat shift neighbouring corners alike. Least squares take every corner for a witness of its own, and tell standard
errors of a third of what they are (`tests/test_correlated.py`). They are had from leaving out each position in turn:
the jackknife over clusters, here of the linearized equations (MacKinnon & White 1985; Bell & McCaffrey 2002).

A board that is bent is bent in all positions, which no scatter tells. How much its corners would have to be off for the
residuals is estimated beside the cameras; what that would do to them counts as their uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from tracker.cameras.calibration._bundle import Observations, State, normal_equations, residuals
from tracker.cameras.calibration._objects import Boards
from tracker.foundation.arrays import Array, Mask

_CHANCE = 1e-3
"""Of taking noise for a deformation of the board, one of four, by Student's t of as many positions. With seven it is
more, as each of them tells much of the interior: 1 of 16 flat boards seemed 0.1 mm bent."""

Inverse = Callable[[Array], Array]
"""Inverse of a normal matrix of the cameras' unknowns."""


@dataclass(frozen=True)
class Scatter:
    """What the positions of a board tell of the precision of the cameras."""

    covariance: Array
    """(F, F) of the free unknowns."""

    bent_m: float
    """How far the board's corners seem to be from where they should be, at most; 0 if that is within the noise."""


def scatter(state: State, observations: Observations, weights: Array, free: Mask, inverse: Inverse) -> Scatter:
    """Covariance of the cameras' unknowns from leaving out every position of the board in turn.

    Args:
        state: adjusted cameras and boards.
        observations: N images of corners.
        weights: (N,) 1/px^2; 0 for those that were left out.
        free: (V, 17) unknowns that were determined.
        inverse: of their normal matrix (F, F), under the datum of the adjustment.
    """
    boards = state.objects
    assert isinstance(boards, Boards)
    shapes = _deformations(boards)
    images = _changes(state, observations, shapes)
    shown = np.unique(boards.owners[observations.points[weights > 0]])
    equations = [_equations_of(g, state, observations, weights, images, free.ravel()) for g in shown]
    normals, sides = np.stack([normal for normal, _ in equations]), np.stack([side for _, side in equations])
    n = int(free.sum())
    steps = _left_out(normals[:, :n, :n], sides[:, :n], inverse)
    covariance = _jackknifed(steps)

    def with_deformations(normal: Array) -> Array:
        return _bordered(normal, n, inverse)

    whole = with_deformations(normals.sum(axis=0)) @ sides.sum(axis=0)
    spread = np.sqrt(np.diag(_jackknifed(_left_out(normals, sides, with_deformations)))[n:])
    heights = whole[n:]
    if not (np.abs(heights) > stdtrit(len(normals) - 1, 1 - _CHANCE / 2) * spread).any():
        return Scatter(covariance, 0.0)
    bent = np.einsum("k,kpi->pi", heights, shapes)
    return Scatter(covariance + np.outer(whole[:n], whole[:n]), float(np.linalg.norm(bent, axis=1).max()))


def _deformations(boards: Boards) -> Array:
    """(4, P, 3) shifts of the corners, at most 1: three ways to bend a board, and a print that is longer than wide."""
    x, y = ((boards.shape - boards.shape.mean(axis=0)) / np.ptp(boards.shape, axis=0).clip(1e-9).max() * 2)[:, :2].T
    none = np.zeros_like(x)
    bends = [np.column_stack([none, none, height]) for height in (x * x, x * y, y * y)]
    return np.stack([*bends, np.column_stack([x, -y, none])])


def _changes(state: State, observations: Observations, shapes: Array) -> Array:
    """(K, N, 2) by how much the images move for a metre of each deformation."""
    boards = state.objects
    assert isinstance(boards, Boards)
    before, step = residuals(state, observations), 1e-6
    changed = [replace(boards, shape=boards.shape + step * shape) for shape in shapes]
    moved = [(before - residuals(State(state.cameras, one), observations)) / step for one in changed]
    return np.nan_to_num(np.stack(moved))


def _equations_of(
    g: int, state: State, observations: Observations, weights: Array, images: Array, free: Mask
) -> tuple[Array, Array]:
    """Normal matrix (F + K, F + K) and right side (F + K,) of one position, its own pose eliminated.

    The adjustment's own equations do all: with the images of a deformation in place of the residuals, their right
    side is the mixed part.
    """
    boards = state.objects
    assert isinstance(boards, Boards)
    points = np.flatnonzero(boards.owners == g)
    mine = boards.owners[observations.points] == g
    own = replace(boards, shape=boards.shape[points], owners=0 * points, poses=boards.poses[g : g + 1])
    alone = State(state.cameras, own)
    rows = observations.chosen(mine)
    rows = replace(rows, points=rows.points - points[0])
    weight, shifts = weights[mine], images[:, mine]
    counted = rows.counted(weight > 0, len(points))
    errors = np.nan_to_num(residuals(alone, rows))
    projected = rows.pixels - errors
    real = normal_equations(alone, rows, weight, counted)
    mixed = [normal_equations(alone, replace(rows, pixels=projected + shift), weight, counted) for shift in shifts]
    poses = np.stack([one.object_sides[0] for one in mixed])
    within = real.inverses[0] @ poses.T
    deformed = np.einsum("kni,n,lni->kl", shifts, weight, shifts) - poses @ within
    side = np.einsum("kni,n,ni->k", shifts, weight, errors) - real.object_sides[0] @ within
    across = np.stack([one.side[free] for one in mixed], axis=1)
    normal = np.block([[real.normal[np.ix_(free, free)], across], [across.T, deformed]])
    return normal, np.concatenate([real.side[free], side])


def _left_out(normals: Array, sides: Array, inverse: Inverse) -> Array:
    """(G, F) solutions without each of the positions."""
    normal, side = normals.sum(axis=0), sides.sum(axis=0)
    pairs = zip(normals, sides, strict=True)
    return np.stack([inverse(normal - mine) @ (side - own) for mine, own in pairs])


def _jackknifed(steps: Array) -> Array:
    n, off = len(steps), steps - steps.mean(axis=0)
    covariance: Array = (n - 1) / n * off.T @ off
    return covariance


def _bordered(normal: Array, n: int, inverse: Inverse) -> Array:
    """Inverse of a matrix whose first n unknowns need a datum, block by block."""
    first, mixed, last = inverse(normal[:n, :n]), normal[:n, n:], normal[n:, n:]
    rest = np.linalg.pinv(last - mixed.T @ first @ mixed, rcond=1e-10, hermitian=True)
    side = first @ mixed @ rest
    return np.block([[first + side @ mixed.T @ first, -side], [-side.T, rest]])
